/* Scratch files for tests: a directory of their own, gone at exit of the test's process. */
#ifndef MECHKIT_TESTS_SUPPORT_FILES_H
#define MECHKIT_TESTS_SUPPORT_FILES_H

#ifdef __cplusplus
extern "C" {
#endif

/* Path of `name` in this process's scratch directory (made on first use). Static storage of 64
 * paths in turn. */
const char *scratch(const char *name);

/* Writes text to a scratch file and returns its path. */
const char *scratch_text(const char *name, const char *text);

/* The largest size a file may have from here on: a disk that fills up. 0: no limit (checks report
 * through a file of their own, so lift it before the next one). */
void limit_file_size(unsigned long bytes);

/* How many files of the scratch directory match a shell pattern. */
int count_files(const char *pattern);

/* How many descriptors this process has open. */
int open_files(void);

/* Whole content of a file as a NUL-terminated string to free; NULL when it cannot be read. */
char *slurp_file(const char *path);

#ifdef __cplusplus
}
#endif

#endif

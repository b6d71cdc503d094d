/* A file that is replaced as a whole: text goes to a temporary file beside it, which takes its name
 * at the end. Whatever fails before leaves the old file as it was. What is no regular file (a
 * device, a pipe) cannot be replaced and is written in place. */
#ifndef MECHKIT_BASE_OUT_FILE_H
#define MECHKIT_BASE_OUT_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif

struct mk_out_file {
    int fd;
    const char *path; /* as the user gave it, for messages; the caller's */
    char *target;     /* `path` with symbolic links followed */
    char *temporary;  /* NULL: written in place */
};

/* Opens for writing, and removes what a killed program left beside the target. On failure there is
 * nothing to clean up. */
MK_NODISCARD enum mk_status mk_out_file_open(struct mk_out_file *file, const char *path,
                                             struct mk_error *err);
MK_NODISCARD enum mk_status mk_out_file_write(struct mk_out_file *file, const char *data,
                                              size_t size, struct mk_error *err);
/* Brings the data to the disk and gives the file its name. Closes also on failure, then without a
 * trace. */
MK_NODISCARD enum mk_status mk_out_file_commit(struct mk_out_file *file, struct mk_error *err);
/* Closes and removes the temporary file. */
void mk_out_file_abandon(struct mk_out_file *file);
/* Commits what was written well (`st`), else abandons it. The first failure of the two. */
MK_NODISCARD enum mk_status mk_out_file_finish(struct mk_out_file *file, enum mk_status st,
                                               struct mk_error *err);
/* All of the above for what is there already. */
MK_NODISCARD enum mk_status mk_out_file_save(const char *path, const char *data, size_t size,
                                             struct mk_error *err);

/* Whether it could be opened, before work that takes long; NULL: there is no such output. Devices,
 * pipes and standard output ("-") are left alone. */
MK_NODISCARD enum mk_status mk_out_file_check(const char *path, struct mk_error *err);

/* The same for text that is printed: into memory first, so that a full disk fails in one place. */
struct mk_out_text {
    FILE *stream;
    const char *path; /* the caller's */
    char *text;
    size_t size;
};

MK_NODISCARD enum mk_status mk_out_text_open(struct mk_out_text *out, const char *path,
                                             struct mk_error *err);
/* Writes what was printed to the file. Closes and frees, also on failure. */
MK_NODISCARD enum mk_status mk_out_text_save(struct mk_out_text *out, struct mk_error *err);

/* write(2) until all is written. 0 or errno; *written (NULL allowed) counts also on failure. */
int mk_write_all(int fd, const char *data, size_t size, size_t *written);
/* Copies a file to a name that must be free (EEXIST), and brings it to the disk. 0 or errno; on
 * failure, of reading too, nothing of the copy is left. */
int mk_copy_new(const char *from, const char *to);
/* fsync(2), where the file is of a kind that has it. 0 or errno. */
int mk_sync(int fd);
/* Closes what was written to: `failure`, or, where that is 0, why it could not be closed. */
int mk_close_written(int fd, int failure);

#ifdef __cplusplus
}
#endif
#endif

/* The bytes of a fuzzer as files. */
#ifndef MECHKIT_FUZZ_FILE_H
#define MECHKIT_FUZZ_FILE_H

#include <stddef.h>
#include <stdint.h>

/* A file in memory with these bytes; NUMBER of a few that are there at the same time. The path is
 * static. */
const char *fuzz_file(int number, const uint8_t *data, size_t size);
/* A path to write to, removed at exit. */
const char *fuzz_scratch(const char *name);
/* Whether two files hold the same. */
int fuzz_same_files(const char *a, const char *b);

#endif

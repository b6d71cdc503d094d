/* A file that is replaced as a whole: text goes to a temporary file beside it, which takes its name
 * at the end. Whatever fails before leaves the old file as it was. What is no regular file (a
 * device, a pipe) cannot be replaced and is written in place. */
#ifndef MECHKIT_BASE_OUT_FILE_H
#define MECHKIT_BASE_OUT_FILE_H

#include <stdbool.h>
#include <stddef.h>

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

/* Opens for writing. On failure there is nothing to clean up. */
MK_NODISCARD enum mk_status mk_out_file_open(struct mk_out_file *file, const char *path,
                                             struct mk_error *err);
MK_NODISCARD enum mk_status mk_out_file_write(struct mk_out_file *file, const char *data,
                                              size_t size, struct mk_error *err);
/* Brings the data to the disk and gives the file its name. Closes also on failure, then without a
 * trace. */
MK_NODISCARD enum mk_status mk_out_file_commit(struct mk_out_file *file, struct mk_error *err);
/* Closes and removes the temporary file. */
void mk_out_file_abandon(struct mk_out_file *file);

/* write(2) until all is written. 0 or errno; *written (NULL allowed) counts also on failure. */
int mk_write_all(int fd, const char *data, size_t size, size_t *written);
/* fsync(2), where the file is of a kind that has it. 0 or errno. */
int mk_sync(int fd);

#ifdef __cplusplus
}
#endif
#endif

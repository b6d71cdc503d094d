/* Files that another file or a command names. They are read wherever that one is, and a pipe or a
 * device in their place may keep whoever reads it waiting for good: regular files only. */
#ifndef MECHKIT_BASE_IN_FILE_H
#define MECHKIT_BASE_IN_FILE_H

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Opens for reading, without waiting. -1: *other says what is there that is no file, as "it is a
 * pipe", or is NULL and errno says why nothing could be opened. */
int mk_in_file_open(const char *path, const char **other);
/* Whether that would open it; MK_ERR_PARSE: it is no file. `what` as "the model". */
MK_NODISCARD enum mk_status mk_in_file_check(const char *path, const char *what,
                                             struct mk_error *err);

#ifdef __cplusplus
}
#endif
#endif

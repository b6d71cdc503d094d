/* A log under another name: what the name ends in says whether the copy is compressed. */
#ifndef MECHKIT_BASE_LOG_COPY_H
#define MECHKIT_BASE_LOG_COPY_H

#include <stdbool.h>

/* Whether a file of one name, as it is, may have the other: both end in .gz, or neither does. */
bool mk_log_paths_agree(const char *one, const char *other);

/* Copies `from` to `to`, which must be free (EEXIST), compressed where `name` ends in .gz, plain
 * where it does not; `name` is what `to` is going to be called. Brings it to the disk. 0 or errno;
 * on failure nothing of the copy is left. */
int mk_log_copy_new(const char *from, const char *to, const char *name);

/* Whether a file may be replaced by a log: it is one, plain or compressed, or it is empty. */
bool mk_log_may_replace(const char *path);

#endif

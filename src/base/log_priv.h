/* What reading and writing logs share. */
#ifndef MECHKIT_BASE_LOG_PRIV_H
#define MECHKIT_BASE_LOG_PRIV_H

#include <stdbool.h>
#include <stddef.h>

#include "mechkit/log.h"

/* Appends a metadata line; key "" keeps a comment that has no key. Copies both. */
enum mk_status mk_log_append_meta(struct mk_log *log, const char *key, size_t key_length,
                                  const char *value, size_t value_length);

bool mk_log_path_is_compressed(const char *path);

#endif

/* What the parts of the log module share. Not for other folders. */
#ifndef MECHKIT_BASE_LOG_PRIV_H
#define MECHKIT_BASE_LOG_PRIV_H

#include <stdbool.h>
#include <stddef.h>

#include "mechkit/log.h"

#define MK_LOG_VERSION "1"
#define MK_LOG_VERSION_KEY "mechkit-log"

/* True for a column whose cells must be numbers. */
bool mk_log_column_is_known(const char *name);

/* Appends a metadata line; key "" keeps a comment that has no key. Copies both. */
enum mk_status mk_log_append_meta(struct mk_log *log, const char *key, size_t key_length,
                                  const char *value, size_t value_length);

bool mk_log_path_is_compressed(const char *path);

/* --- text on its way to a file --------------------------------------------------------------- */

/* Whole lines, collected. Grows; a failed allocation sticks in `failed`. */
struct mk_lines {
    char *text;
    size_t used;
    size_t room;
    bool failed;
};

/* Room for `size` more bytes: where they go, or NULL on no memory. */
char *mk_lines_reserve(struct mk_lines *lines, size_t size);
void mk_lines_free(struct mk_lines *lines);

/* "# key: value"; line breaks in either become blanks. */
void mk_lines_meta(struct mk_lines *lines, const char *key, const char *value);

/* The version line, unless the metadata have one, and the metadata. */
void mk_lines_preamble(struct mk_lines *lines, const struct mk_log_meta *meta, size_t meta_count);

/* The header line. */
void mk_lines_names(struct mk_lines *lines, const char *const *names, size_t count);

/* NULL when the names can head a log, else what is wrong with *bad. */
const char *mk_log_names_problem(const char *const *names, size_t count, const char **bad);

#endif

/* Logs: CSV with metadata, read whole or written row by row (docs/formats.md, "Log").
 *
 *     # mechkit-log: 1
 *     # rig: pendubot
 *     t,q1,q2,u
 *     0,-1.5707963267949,0,0
 *
 * Angles in rad, times in s. A missing value (empty field, "nan") is NaN. Columns that mechkit does
 * not know are kept: numbers as doubles; to the letter as text when a cell is no number, or a whole
 * number that a double cannot hold. A "#" line without a colon is a comment, kept as metadata with
 * an empty key. A path that ends in ".gz" is compressed. Not RT-safe (allocates, does I/O); many
 * threads may read a struct mk_log while none writes it.
 */
#ifndef MECHKIT_LOG_H
#define MECHKIT_LOG_H

#include <stdbool.h>
#include <stddef.h>

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

struct mk_log_column {
    char *name;   /* as in the header line, blanks trimmed */
    double *data; /* `rows` values; NULL for a text column */
    char **text;  /* `rows` cells of a column with cells that are no numbers; NULL otherwise */
};

struct mk_log_meta {
    char *key;
    char *value;
};

struct mk_log {
    char *path; /* where it was read from, for messages; may be NULL */
    size_t rows;
    size_t column_count;
    struct mk_log_column *columns;
    size_t meta_count;
    struct mk_log_meta *meta; /* in file order; a repeated key keeps all its lines */
    bool truncated;           /* the last line was incomplete and was left out */
    int first_row_line;       /* line of the first data row in the file, for messages */
};

/* Reads a whole log. Errors name file, line and column (column = 1-based field):
 * MK_ERR_NOTFOUND, MK_ERR_PERM, MK_ERR_IO (also a damaged .gz), MK_ERR_NOMEM, MK_ERR_PARSE (no
 * header, a header without `t`, a column name twice, a wrong number of fields, text in a known
 * column, time missing or not strictly increasing, no rows, another format version). A last line
 * without a newline is left out and `truncated` is set when fields are missing or a number is
 * damaged; in a log with "mechkit-log" metadata always, since there every whole line has one and a
 * number may have lost its last digits. A row with empty fields is kept with NaN, whatever the
 * number of NaN, but time itself must be there; a line of commas alone is skipped.
 * On success the caller owns *out: mk_log_free. */
MK_NODISCARD enum mk_status mk_log_read(const char *path, struct mk_log **out,
                                        struct mk_error *err);

/* An empty log with room for `rows` rows and no columns; the caller owns it. */
MK_NODISCARD enum mk_status mk_log_create(size_t rows, struct mk_log **out);
void mk_log_free(struct mk_log *log); /* NULL allowed */

/* Appends a number column and returns its data (NaN-filled, owned by the log), NULL on no memory.
 */
double *mk_log_add_column(struct mk_log *log, const char *name);

/* Data of a number column, NULL when there is none of that name. */
const double *mk_log_get(const struct mk_log *log, const char *name);
/* Adds `by` to all values of a number column; a column that is not there stays so. */
void mk_log_shift(struct mk_log *log, const char *name, double by);
/* Writes log->rows values over those of a number column; a column that is not there stays so. */
void mk_log_replace(struct mk_log *log, const char *name, const double *values);

/* The column of a joint's angle, "q1" for joint 0; "" for a joint that no log has. Static. */
const char *mk_log_angle(int joint);
/* That of its speed, "dq1". */
const char *mk_log_speed(int joint);

/* Metadata value of the first line with that key, NULL when absent. */
const char *mk_log_find_meta(const struct mk_log *log, const char *key);
/* Replaces that value or appends a line. MK_ERR_NOMEM; MK_ERR_INVALID: no key, or a colon or line
 * break in it. */
MK_NODISCARD enum mk_status mk_log_set_meta(struct mk_log *log, const char *key, const char *value);

/* Writes the whole log to a temporary file beside `path` and renames it, so that `path` is either
 * the old file or the whole new one. Numbers are written so that they read back as the same
 * double. A device or a pipe is written in place. MK_ERR_IO, MK_ERR_NOSPACE, MK_ERR_PERM,
 * MK_ERR_NOTFOUND (no such folder), MK_ERR_NOMEM, MK_ERR_INVALID (columns that could not be read
 * back: no `t`, a name twice, a comma in a name). */
MK_NODISCARD enum mk_status mk_log_write(const char *path, const struct mk_log *log,
                                         struct mk_error *err);

/* --- writing while a run goes on ------------------------------------------------------------ */

struct mk_log_writer;

/* Starts a log at `path` (an existing file is an error unless `overwrite`): writes metadata
 * (meta_count may be 0; "mechkit-log: 1" is put first if absent) and the header line. Never
 * compressed: a killed run must stay readable up to its last complete line. */
MK_NODISCARD enum mk_status mk_log_writer_open(const char *path, bool overwrite,
                                               const struct mk_log_meta *meta, size_t meta_count,
                                               const char *const *columns, size_t column_count,
                                               struct mk_log_writer **out, struct mk_error *err);

/* Appends one row of `column_count` values (NaN is written as an empty field). Buffered. After a
 * failure every later call returns the same failure: MK_ERR_NOSPACE, MK_ERR_IO. */
MK_NODISCARD enum mk_status mk_log_writer_row(struct mk_log_writer *w, const double *values);

/* Hands what is buffered to the operating system (only whole lines are ever handed over). */
MK_NODISCARD enum mk_status mk_log_writer_flush(struct mk_log_writer *w, struct mk_error *err);

/* Appends a "# key: value" line between rows (an event; readers take it as metadata). Line breaks
 * in the value become blanks. MK_ERR_INVALID (which does not last): no key, or a colon in it. */
MK_NODISCARD enum mk_status mk_log_writer_note(struct mk_log_writer *w, const char *key,
                                               const char *value);

/* Flushes, fsyncs and frees. Frees also on failure. NULL allowed. */
enum mk_status mk_log_writer_close(struct mk_log_writer *w, struct mk_error *err);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif

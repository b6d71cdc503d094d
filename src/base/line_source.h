/* Lines of a text file, plain or gzip, as a stream: memory is one buffer, whatever the file. */
#ifndef MECHKIT_BASE_LINE_SOURCE_H
#define MECHKIT_BASE_LINE_SOURCE_H

#include <stdbool.h>
#include <stddef.h>
#include <zlib.h>

#include "mechkit/status.h"

/* Text that is not NUL-terminated. */
struct mk_span {
    const char *begin, *end;
};

struct mk_line_source {
    const char *path;     /* the caller's */
    struct mk_error *err; /* where failures are told */
    int line;             /* number of the current line, from 1 */
    bool unterminated;    /* the current line is the last and has no newline */
    bool can_rewind;      /* false: a pipe */

    gzFile gz;
    char *buffer;
    size_t begin, end, room;
    bool at_end; /* the file has no more than the buffer */
};

/* Opens a file for reading. On failure there is nothing to close. */
MK_NODISCARD enum mk_status mk_line_source_open(struct mk_line_source *s, const char *path,
                                                struct mk_error *err);
void mk_line_source_close(struct mk_line_source *s);

/* The next line without its line end (LF or CRLF) and without a byte order mark, valid until the
 * next call; *more is false when there is none. MK_ERR_IO, MK_ERR_NOMEM, MK_ERR_PARSE (a line that
 * no text file has). */
MK_NODISCARD enum mk_status mk_line_source_next(struct mk_line_source *s, struct mk_span *line,
                                                bool *more);

/* Back to the first line. Only when can_rewind. */
MK_NODISCARD enum mk_status mk_line_source_rewind(struct mk_line_source *s);

#endif

#include "base/line_source.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/text.h"

#define CHUNK (1u << 18)
#define LINE_MAX_BYTES (1u << 20)

static enum mk_status no_memory(struct mk_line_source *s)
{
    return mk_error_at(s->err, MK_ERR_NOMEM, s->path, s->line, 0, "out of memory");
}

enum mk_status mk_line_source_open(struct mk_line_source *s, const char *path, struct mk_error *err)
{
    *s = (struct mk_line_source){.path = path, .err = err, .room = CHUNK};
    struct stat info;
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return mk_error_errno(err, errno, path, "cannot read");
    int failure = 0;
    if (fstat(fd, &info) != 0)
        failure = errno;
    else if (S_ISDIR(info.st_mode))
        failure = EISDIR;
    if (failure == 0) {
        s->can_rewind = S_ISREG(info.st_mode);
        s->buffer = malloc(s->room);
        s->gz = s->buffer ? gzdopen(fd, "rb") : NULL;
        failure = s->gz ? 0 : ENOMEM;
    }
    if (failure == 0) {
        gzbuffer(s->gz, CHUNK);
        return MK_OK;
    }
    free(s->buffer);
    close(fd);
    return mk_error_errno(err, failure, path, "cannot read");
}

void mk_line_source_close(struct mk_line_source *s)
{
    gzclose_r(s->gz);
    free(s->buffer);
}

enum mk_status mk_line_source_rewind(struct mk_line_source *s)
{
    if (gzrewind(s->gz) != 0)
        return mk_error_errno(s->err, errno, s->path, "cannot read again");
    s->begin = s->end = 0;
    s->line = 0;
    s->at_end = s->unterminated = false;
    return MK_OK;
}

static enum mk_status input_failure(struct mk_line_source *s)
{
    int code = Z_OK;
    const char *text = gzerror(s->gz, &code);
    if (code == Z_ERRNO)
        return mk_error_errno(s->err, errno ? errno : EIO, s->path, "cannot read");
    if (code == Z_MEM_ERROR)
        return no_memory(s);
    /* zlib begins with the name of the file, which it does not know: "<fd:3>: ". */
    const char *name_end = *text == '<' ? strstr(text, ">: ") : NULL;
    const char *why = code == Z_BUF_ERROR ? "it ends too early" : name_end ? name_end + 3 : text;
    if (s->line == 0)
        return mk_error_at(s->err, MK_ERR_IO, s->path, 0, 0,
                           "the compressed file is damaged: %s; no line could be read", why);
    return mk_error_at(s->err, MK_ERR_IO, s->path, 0, 0,
                       "the compressed file is damaged after line %d: %s", s->line, why);
}

/* More of the file behind the line that has begun. */
static enum mk_status refill(struct mk_line_source *s)
{
    memmove(s->buffer, s->buffer + s->begin, s->end - s->begin);
    s->end -= s->begin;
    s->begin = 0;
    if (s->end >= LINE_MAX_BYTES)
        return mk_error_at(s->err, MK_ERR_PARSE, s->path, s->line + 1, 0,
                           "the line is longer than %u bytes: this is no text file",
                           LINE_MAX_BYTES);
    if (s->end == s->room) {
        char *larger = realloc(s->buffer, 2 * s->room);
        if (!larger)
            return no_memory(s);
        s->buffer = larger;
        s->room *= 2;
    }
    errno = 0;
    size_t wanted = s->room - s->end;
    int got = gzread(s->gz, s->buffer + s->end, (unsigned)wanted), code = Z_OK;
    gzerror(s->gz, &code); /* a file that ends too early gives what it has and this code */
    if (got < 0 || code != Z_OK)
        return input_failure(s);
    s->end += (size_t)got;
    s->at_end = (size_t)got < wanted;
    return MK_OK;
}

/* The line of the buffer that ends at `end`. */
static struct mk_span cut(struct mk_line_source *s, const char *end)
{
    struct mk_span line = {s->buffer + s->begin, end};
    s->line++;
    s->begin = (size_t)(end - s->buffer) + (s->unterminated ? 0 : 1);
    if (line.end > line.begin && line.end[-1] == '\r')
        line.end--;
    if (s->line == 1)
        line.begin += mk_byte_order_mark(line.begin, (size_t)(line.end - line.begin));
    return line;
}

enum mk_status mk_line_source_next(struct mk_line_source *s, struct mk_span *line, bool *more)
{
    size_t searched = 0;
    for (;;) {
        const char *from = s->buffer + s->begin;
        size_t held = s->end - s->begin;
        const char *newline = memchr(from + searched, '\n', held - searched);
        *more = newline || held > 0;
        if (newline || s->at_end) {
            s->unterminated = !newline;
            if (*more)
                *line = cut(s, newline ? newline : from + held);
            return MK_OK;
        }
        searched = held;
        enum mk_status st = refill(s);
        if (st != MK_OK)
            return st;
    }
}

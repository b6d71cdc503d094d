#include "console/script/cmdfile.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/in_file.h"
#include "base/text.h"
#include "console/script/cmd.h"

#define MAX_SOURCES 16    /* nested files */
#define MAX_FILES 1000    /* in all: files that source others twice multiply */
#define MAX_LINES 1000000 /* in all: a pipe may never end */
#define MAX_BLOCKS 16     /* nested repeats */
#define MAX_LINE 1024
#define MAX_COUNT 1000000

enum kind { STEP_COMMAND, STEP_REPEAT, STEP_END };

struct step {
    enum kind kind;
    char *file; /* path as reported */
    int line;
    char *text;     /* command as written: parsing cuts it, so each execution has a copy */
    long count;     /* repeat */
    size_t partner; /* of repeat: its end; of end: its repeat */
};

struct cmdfile {
    size_t count, room, commands;
    struct step *steps;
};

struct reader {
    struct cmdfile *file;
    void (*report)(void *, const struct mk_error *);
    void *user;
    struct mk_error *err;
    enum mk_status first; /* first error */
    bool sourced;         /* the first file as well */
    int depth, files;
    long lines;
    struct {
        dev_t device;
        ino_t number;
    } reading[MAX_SOURCES];  /* files that are being read, by depth */
    size_t open[MAX_BLOCKS]; /* repeats that wait for their end */
    int open_count;
    struct cmd_known known;
};

static void complain(struct reader *r, const struct mk_error *err)
{
    if (r->report)
        r->report(r->user, err);
    if (r->first == MK_OK) {
        r->first = err->status;
        if (r->err)
            *r->err = *err;
    }
}

static void complain_at(struct reader *r, const char *path, int line, const char *message)
{
    struct mk_error err = MK_ERROR_INIT;
    mk_error_at(&err, MK_ERR_PARSE, path, line, 0, "%s", message);
    complain(r, &err);
}

static struct step *add_step(struct reader *r, enum kind kind, const char *path, int line,
                             const char *text)
{
    struct cmdfile *f = r->file;
    if (f->count == f->room) {
        size_t room = f->room ? 2 * f->room : 64;
        struct step *steps = realloc(f->steps, room * sizeof *steps);
        if (!steps)
            return NULL;
        f->steps = steps;
        f->room = room;
    }
    struct step *s = &f->steps[f->count];
    *s = (struct step){.kind = kind, .line = line, .file = strdup(path), .text = strdup(text)};
    if (!s->file || !s->text) {
        free(s->file);
        free(s->text);
        return NULL;
    }
    f->count++;
    f->commands += kind == STEP_COMMAND;
    return s;
}

static void read_file(struct reader *r, const char *path, const char *from, int from_line);

/* Rest of the line when its first word is `word`, else NULL. */
static const char *after_word(const char *line, const char *word)
{
    line += strspn(line, " \t");
    size_t n = strlen(word);
    if (strncmp(line, word, n) != 0 || (line[n] && !strchr(" \t\r\n", line[n])))
        return NULL;
    return line + n + strspn(line + n, " \t");
}

static bool take_word(const char *text, char *word, size_t size)
{
    size_t n = strcspn(text, " \t\r\n");
    if (n == 0 || n >= size)
        return false;
    memcpy(word, text, n);
    word[n] = '\0';
    text += n + strspn(text + n, " \t\r\n");
    return *text == '\0' || *text == '#';
}

static void on_source(struct reader *r, const char *path, int line, const char *rest)
{
    char name[MAX_LINE], full[2 * MAX_LINE];
    if (!take_word(rest, name, sizeof name)) {
        complain_at(r, path, line, "usage: source FILE");
        return;
    }
    const char *slash = strrchr(path, '/');
    if (name[0] == '/' || !slash)
        snprintf(full, sizeof full, "%s", name);
    else
        snprintf(full, sizeof full, "%.*s/%s", (int)(slash - path), path, name);
    read_file(r, full, path, line);
}

static void on_repeat(struct reader *r, const char *path, int line, const char *rest)
{
    char word[32], *end = word;
    long count = take_word(rest, word, sizeof word) ? strtol(word, &end, 10) : 0;
    if (end == word || *end || count < 1 || count > MAX_COUNT) {
        complain_at(r, path, line, "usage: repeat N, with N from 1 to 1000000");
        return;
    }
    if (r->open_count == MAX_BLOCKS) {
        complain_at(r, path, line, "blocks are nested too deeply");
        return;
    }
    struct step *s = add_step(r, STEP_REPEAT, path, line, "");
    if (!s)
        return;
    s->count = count;
    r->open[r->open_count++] = r->file->count - 1;
}

static void on_end(struct reader *r, const char *path, int line, int floor)
{
    if (r->open_count <= floor) {
        complain_at(r, path, line, "`end` without `repeat`");
        return;
    }
    size_t repeat = r->open[--r->open_count];
    struct step *s = add_step(r, STEP_END, path, line, "");
    if (!s)
        return;
    s->partner = repeat;
    r->file->steps[repeat].partner = r->file->count - 1;
}

/* "dir" of "dir/file"; "" where there is none. */
static void folder_of(const char *path, char *folder, size_t size)
{
    const char *slash = strrchr(path, '/');
    snprintf(folder, size, "%.*s", slash ? (int)(slash - path) : 0, path);
}

static void on_command(struct reader *r, const char *path, int line, const char *text)
{
    char copy[MAX_LINE], folder[SESSION_PATH], why[512];
    struct cmd_line parsed;
    struct mk_error err = MK_ERROR_INIT;
    snprintf(copy, sizeof copy, "%s", text);
    folder_of(path, folder, sizeof folder);
    r->known.folder = folder;
    if (cmd_parse(copy, &r->known, &parsed, &err) != MK_OK) {
        /* The place in the script is what helps; a data file's own place goes into the message. */
        complain_at(r, path, line, mk_error_format(&err, why, sizeof why));
    } else if (parsed.cmd) {
        add_step(r, STEP_COMMAND, path, line, text);
    }
}

/* What some editors put before the first line of UTF-8. */
static void drop_byte_order_mark(char *line)
{
    const size_t length = mk_byte_order_mark(line, strlen(line));
    memmove(line, line + length, strlen(line + length) + 1);
}

/* fgets into a line of MAX_LINE characters. */
static bool next_line(char *line, FILE *in, bool *has_zeros)
{
    memset(line, 1, MAX_LINE); /* the last zero in it is then the one behind the text */
    if (!fgets(line, MAX_LINE, in))
        return false;
    size_t end = MAX_LINE - 1;
    while (line[end] != '\0')
        end--;
    *has_zeros = strlen(line) < end;
    return true;
}

static void read_line(struct reader *r, const char *line, const char *path, int number, int floor)
{
    const char *rest;
    if ((rest = after_word(line, "source")))
        on_source(r, path, number, rest);
    else if ((rest = after_word(line, "repeat")))
        on_repeat(r, path, number, rest);
    else if (after_word(line, "end"))
        on_end(r, path, number, floor);
    else
        on_command(r, path, number, line);
}

static void read_lines(struct reader *r, FILE *in, const char *path)
{
    char line[MAX_LINE];
    int number = 0, floor = r->open_count;
    bool has_zeros;
    while (next_line(line, in, &has_zeros)) {
        number++;
        if (++r->lines > MAX_LINES) {
            if (r->lines == MAX_LINES + 1)
                complain_at(r, path, number, "more than 1000000 lines in all");
            return;
        }
        if (has_zeros) {
            complain_at(r, path, number, "a zero byte: this is no text file");
            return;
        }
        if (!strchr(line, '\n') && !feof(in)) {
            complain_at(r, path, number, "the line is too long: at most 1000 characters");
            return;
        }
        line[strcspn(line, "\n")] = '\0';
        const size_t length = strlen(line);
        if (length > 0 && line[length - 1] == '\r')
            line[length - 1] = '\0';
        if (strchr(line, '\r')) {
            complain_at(r, path, number,
                        "a carriage return within a line: lines end in a line feed");
            return;
        }
        if (number == 1)
            drop_byte_order_mark(line);
        read_line(r, line, path, number, floor);
    }
    if (r->open_count > floor) {
        complain_at(r, path, r->file->steps[r->open[r->open_count - 1]].line,
                    "`repeat` without `end`");
        r->open_count = floor;
    }
}

/* Writes down that `in` is being read; false: it is already. */
static bool enter(struct reader *r, FILE *in)
{
    struct stat info;
    if (fstat(fileno(in), &info) != 0)
        return true;
    for (int i = 0; i < r->depth; i++)
        if (r->reading[i].device == info.st_dev && r->reading[i].number == info.st_ino)
            return false;
    r->reading[r->depth].device = info.st_dev;
    r->reading[r->depth].number = info.st_ino;
    return true;
}

/* What is sourced must be a file. The script itself may come from a pipe. */
static FILE *open_file(struct reader *r, const char *path, const char *from, int from_line)
{
    struct mk_error err = MK_ERROR_INIT;
    const char *other = NULL;
    bool sourced = from || r->sourced;
    if (!sourced && strcmp(path, "-") == 0)
        return stdin;
    int fd = sourced ? mk_in_file_open(path, &other) : open(path, O_RDONLY | O_CLOEXEC);
    FILE *in = fd < 0 ? NULL : fdopen(fd, "r");
    if (in)
        return in;
    if (other)
        mk_error_at(&err, MK_ERR_PARSE, from ? from : path, from_line, 0,
                    "cannot source %s: %s, not a file", path, other);
    else
        mk_error_errno(&err, errno, from ? from : path, "cannot read %s", path);
    err.line = from_line;
    complain(r, &err);
    if (fd >= 0)
        close(fd);
    return NULL;
}

static void read_file(struct reader *r, const char *path, const char *from, int from_line)
{
    if (r->depth == MAX_SOURCES) {
        complain_at(r, from, from_line, "files source each other too deeply");
        return;
    }
    if (++r->files > MAX_FILES) {
        if (r->files == MAX_FILES + 1)
            complain_at(r, from, from_line, "more than 1000 files are sourced in all");
        return;
    }
    FILE *in = open_file(r, path, from, from_line);
    if (!in)
        return;
    if (enter(r, in)) {
        r->depth++;
        errno = 0;
        read_lines(r, in, in == stdin ? "standard input" : path);
        if (ferror(in)) { /* a folder, a broken disk */
            struct mk_error err = MK_ERROR_INIT;
            mk_error_errno(&err, errno ? errno : EIO, path, "cannot read");
            complain(r, &err);
        }
        r->depth--;
    } else {
        complain_at(r, from, from_line, "the file sources itself, or one that sources it");
    }
    if (in != stdin)
        fclose(in);
}

static enum mk_status read_all(const char *path, bool sourced, const struct cmd_known *known,
                               void (*report)(void *, const struct mk_error *), void *user,
                               struct cmdfile **out, struct mk_error *err)
{
    struct reader r = {.report = report,
                       .user = user,
                       .err = err,
                       .sourced = sourced,
                       .known = *known,
                       .file = calloc(1, sizeof *r.file)};
    *out = NULL;
    if (!r.file)
        return mk_error_set(err, MK_ERR_NOMEM, "out of memory");
    read_file(&r, path, NULL, 0);
    if (r.first != MK_OK)
        cmdfile_free(r.file);
    else
        *out = r.file;
    return r.first;
}

enum mk_status cmdfile_read(const char *path, const struct cmd_known *known,
                            void (*report)(void *, const struct mk_error *), void *user,
                            struct cmdfile **out, struct mk_error *err)
{
    return read_all(path, false, known, report, user, out, err);
}

enum mk_status cmdfile_source(const char *path, const struct cmd_known *known,
                              void (*report)(void *, const struct mk_error *), void *user,
                              struct cmdfile **out, struct mk_error *err)
{
    return read_all(path, true, known, report, user, out, err);
}

void cmdfile_free(struct cmdfile *file)
{
    if (!file)
        return;
    for (size_t i = 0; i < file->count; i++) {
        free(file->steps[i].file);
        free(file->steps[i].text);
    }
    free(file->steps);
    free(file);
}

size_t cmdfile_command_count(const struct cmdfile *file)
{
    return file->commands;
}

static int execute_step(const struct step *step, struct session *s, struct mk_error *err)
{
    char copy[MAX_LINE];
    struct cmd_line line;
    snprintf(copy, sizeof copy, "%s", step->text);
    folder_of(step->file, s->script_dir, sizeof s->script_dir);
    int st = (int)cmd_parse(copy, NULL, &line, err);
    if (st == MK_OK)
        st = cmd_execute(s, &line, err);
    if (st < 0 && err) {
        /* The place in the script is what helps; a data file's own place goes into the message. */
        char inner[512];
        mk_error_format(err, inner, sizeof inner);
        mk_error_at(err, (enum mk_status)st, step->file, step->line, 0, "%s: %.450s",
                    line.cmd ? line.cmd->name : "?", inner);
    }
    return st;
}

/* Only some commands look at the flag: a block of others, or an empty one, would not end. */
static enum mk_status stop_if_cancelled(const struct step *step, struct session *s,
                                        struct mk_error *err)
{
    struct mk_error late = MK_ERROR_INIT;
    if (session_cancelled(s) == SESSION_GO)
        return MK_OK;
    if (session_halt(s, &late) != MK_OK)
        return mk_error_at(err, MK_ERR_INTR, step->file, step->line, 0, "interrupted; the halt: %s",
                           late.message);
    return mk_error_at(err, MK_ERR_INTR, step->file, step->line, 0,
                       "interrupted; the motor is off");
}

enum mk_status cmdfile_execute(const struct cmdfile *file, struct session *s, struct mk_error *err)
{
    long left[MAX_BLOCKS];
    int depth = 0;
    for (size_t i = 0; i < file->count; i++) {
        const struct step *step = &file->steps[i];
        enum mk_status go_on = stop_if_cancelled(step, s, err);
        if (go_on != MK_OK)
            return go_on;
        if (step->kind == STEP_REPEAT) {
            left[depth++] = step->count;
        } else if (step->kind == STEP_END) {
            if (--left[depth - 1] > 0)
                i = step->partner;
            else
                depth--;
        } else {
            int st = execute_step(step, s, err);
            if (st == CMD_QUIT)
                return MK_OK;
            if (st != MK_OK)
                return (enum mk_status)st;
        }
    }
    return MK_OK;
}

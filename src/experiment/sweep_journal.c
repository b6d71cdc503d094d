#include "experiment/sweep_journal.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/checksum.h"
#include "base/out_file.h"

#define LINE_MAX_BYTES (SWEEP_LINE + 64)
#define SEAL_BYTES 9 /* "89abcdef " */

int sweep_line(char *line, size_t size, size_t index, int outcome, const char *text)
{
    return snprintf(line, size, "%zu,%d,%s\n", index, outcome, text);
}

static int commas(const char *text)
{
    int n = 0;
    for (; *text; text++)
        n += *text == ',';
    return n;
}

bool sweep_split(const struct sweep *s, char *line, size_t *index, int *outcome,
                 const char **columns)
{
    char *end;
    errno = 0;
    unsigned long long run = strtoull(line, &end, 10);
    if (end == line || *end != ',' || errno || run >= s->total)
        return false;
    const char *at = end + 1;
    long word = strtol(at, &end, 10);
    if (end == at || *end != ',' || word < 0 || word >= SWEEP_OUTCOMES || !s->kind->outcome[word])
        return false;
    *index = (size_t)run;
    *outcome = (int)word;
    *columns = end + 1;
    return strlen(*columns) < SWEEP_LINE && commas(*columns) == commas(s->kind->columns);
}

/* In the file a line follows its checksum (its end not counted) in eight hexadecimal digits: a
 * number that a disk spoilt is a number like any other. */
static void seal(char seal_text[SEAL_BYTES + 1], const char *line, size_t length)
{
    snprintf(seal_text, SEAL_BYTES + 1, "%08" PRIx32 " ", mk_checksum(line, length));
}

static bool is_sealed(const char *sealed, size_t length)
{
    char right[SEAL_BYTES + 1];
    if (length < SEAL_BYTES)
        return false;
    seal(right, sealed + SEAL_BYTES, length - SEAL_BYTES);
    return memcmp(sealed, right, SEAL_BYTES) == 0;
}

static bool keep(struct sweep_journal *j, size_t index, int outcome, const char *text)
{
    struct sweep_result *r = &j->result[index];
    char *copy = strdup(text);
    if (!copy)
        return false;
    j->done += r->text == NULL;
    free(r->text);
    *r = (struct sweep_result){copy, outcome};
    return true;
}

static int heading(const struct sweep *s, char *text, size_t size)
{
    return snprintf(text, size, "# mechkit-sweep-journal: 2 %016" PRIx64 " %zu\n", s->fingerprint,
                    s->total);
}

static enum mk_status append(struct sweep_journal *j, const char *text, size_t size,
                             struct mk_error *err)
{
    int failed = mk_write_all(j->fd, text, size, NULL);
    if (failed == 0) {
        j->size += size;
        return MK_OK;
    }
    if (ftruncate(j->fd, (off_t)j->size) != 0)
        return mk_error_errno(err, errno, j->path, "cannot cut off half a line");
    return mk_error_errno(err, failed, j->path, "cannot write down a result");
}

/* The first line says whose the file is. What a kill left of ours may be there, of another's not a
 * byte. */
static enum mk_status check_heading(struct sweep_journal *j, FILE *f, struct mk_error *err)
{
    static const char kind[] = "# mechkit-sweep-journal:";
    char first[100], line[sizeof first];
    size_t size = (size_t)heading(j->sweep, first, sizeof first);
    size_t length = fread(line, 1, sizeof line, f);
    const char *end = memchr(line, '\n', length);
    if (end)
        length = (size_t)(end - line) + 1;
    rewind(f);
    if (length <= size && memcmp(line, first, length) == 0)
        return MK_OK;
    if (length >= sizeof kind - 1 && memcmp(line, kind, sizeof kind - 1) == 0)
        return mk_error_at(err, MK_ERR_STATE, j->path, 1, 0,
                           "belongs to another sweep, or the spec, a model or the program has "
                           "changed since: take the spec back, or remove this file");
    return mk_error_at(
        err, MK_ERR_STATE, j->path, 1, 0,
        "is no journal of a sweep, and this sweep wants to write its own there: move "
        "the file, or give another --out");
}

static enum mk_status take_line(struct sweep_journal *j, int n, char *line, size_t length,
                                struct mk_error *err)
{
    size_t index;
    int outcome;
    const char *text;
    if (!is_sealed(line, length - 1))
        return mk_error_at(
            err, MK_ERR_PARSE, j->path, n, 0,
            "damaged: the checksum is not that of the line; remove the line, and its "
            "run is done again");
    line[length - 1] = '\0';
    if (memchr(line, '\0', length - 1) ||
        !sweep_split(j->sweep, line + SEAL_BYTES, &index, &outcome, &text))
        return mk_error_at(err, MK_ERR_PARSE, j->path, n, 0,
                           "is no line of this sweep's journal: remove the file");
    if (!keep(j, index, outcome, text))
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for the results of a sweep");
    return MK_OK;
}

static enum mk_status read_lines(struct sweep_journal *j, FILE *f, struct mk_error *err)
{
    char *line = NULL;
    size_t room = 0;
    ssize_t length;
    enum mk_status st = check_heading(j, f, err);
    for (int n = 1; st == MK_OK && (length = getline(&line, &room, f)) > 0; n++) {
        bool whole = line[length - 1] == '\n'; /* else killed while it wrote */
        if (n > 1 && whole)
            st = take_line(j, n, line, (size_t)length, err);
        if (whole)
            j->size += (size_t)length;
    }
    if (st == MK_OK && ferror(f))
        st = mk_error_errno(err, errno, j->path, "cannot read the journal");
    free(line);
    return st;
}

/* Reads the file and leaves it at the end of its last whole line. */
static enum mk_status take_over(struct sweep_journal *j, struct mk_error *err)
{
    int fd = dup(j->fd);
    FILE *f = fd < 0 ? NULL : fdopen(fd, "r");
    if (!f)
        return mk_error_errno(err, errno, j->path, "cannot read the journal");
    enum mk_status st = read_lines(j, f, err);
    fclose(f);
    if (st != MK_OK)
        return st;
    if (ftruncate(j->fd, (off_t)j->size) != 0 || lseek(j->fd, 0, SEEK_END) < 0)
        return mk_error_errno(err, errno, j->path, "cannot go on in the journal");
    char text[100];
    return j->size ? MK_OK : append(j, text, (size_t)heading(j->sweep, text, sizeof text), err);
}

enum mk_status sweep_journal_open(struct sweep_journal *j, const struct sweep *s, const char *out,
                                  struct mk_error *err)
{
    *j = (struct sweep_journal){.fd = -1, .sweep = s};
    if (snprintf(j->path, sizeof j->path, "%s.journal", out) >= (int)sizeof j->path)
        return mk_error_set(err, MK_ERR_RANGE, "%s: too long a path", out);
    j->result = calloc(s->total, sizeof *j->result);
    if (!j->result)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for %zu runs", s->total);
    struct stat info;
    j->fd = open(j->path, O_RDWR | O_CREAT | O_CLOEXEC | O_APPEND | O_NONBLOCK, 0666);
    if (j->fd < 0 || fstat(j->fd, &info) != 0)
        return mk_error_errno(err, errno, j->path, "cannot write the journal");
    if (!S_ISREG(info.st_mode))
        return mk_error_at(err, MK_ERR_STATE, j->path, 0, 0,
                           "is no file that a sweep could write its journal to: move it, or give "
                           "another --out");
    if (flock(j->fd, LOCK_EX | LOCK_NB) != 0)
        return mk_error_at(err, MK_ERR_BUSY, j->path, 0, 0,
                           "another process is at this sweep: wait for it, or give another --out");
    return take_over(j, err);
}

enum mk_status sweep_journal_add(struct sweep_journal *j, size_t index, int outcome,
                                 const char *text, struct mk_error *err)
{
    char line[SEAL_BYTES + LINE_MAX_BYTES], seal_text[SEAL_BYTES + 1];
    int size = sweep_line(line + SEAL_BYTES, LINE_MAX_BYTES, index, outcome, text);
    seal(seal_text, line + SEAL_BYTES, (size_t)size - 1);
    memcpy(line, seal_text, SEAL_BYTES);
    if (!keep(j, index, outcome, text))
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for the results of a sweep");
    return append(j, line, SEAL_BYTES + (size_t)size, err);
}

void sweep_journal_close(struct sweep_journal *j, bool finished)
{
    for (size_t i = 0; j->result && i < j->sweep->total; i++)
        free(j->result[i].text);
    free(j->result);
    j->result = NULL;
    if (j->fd < 0)
        return;
    if (finished)
        unlink(j->path);
    close(j->fd);
    j->fd = -1;
}

/* --- the result ----------------------------------------------------------------------------- */

static const char *column_name(const struct sweep_axis *a)
{
    return strchr(a->name, '.') + 1;
}

static void put_rows(FILE *f, const struct sweep_journal *j)
{
    const struct sweep *s = j->sweep;
    char text[SWEEP_WORD];
    fprintf(f, "# mechkit-sweep: 1\n# kind: %s\n# runs: %d\n# program: mechkit " MK_VERSION "\nrun",
            s->kind->name, s->runs);
    for (int i = 0; i < s->axis_count; i++)
        fprintf(f, ",%s", column_name(&s->axis[i]));
    fprintf(f, ",seed,outcome,%s\n", s->kind->columns);
    for (size_t run = 0; run < s->total; run++) {
        fprintf(f, "%zu", run);
        for (int i = 0; i < s->axis_count; i++)
            fprintf(f, ",%s", sweep_value_text(&s->axis[i], sweep_at(s, run, i), text));
        fprintf(f, ",%" PRIu64 ",%s,%s\n", sweep_seed(s, run),
                s->kind->outcome[j->result[run].outcome], j->result[run].text);
    }
}

enum mk_status sweep_write_csv(const struct sweep_journal *j, const char *path,
                               struct mk_error *err)
{
    struct mk_out_text out;
    enum mk_status st = mk_out_text_open(&out, path, err);
    if (st != MK_OK)
        return st;
    put_rows(out.stream, j);
    return mk_out_text_save(&out, err);
}

/* inih tells neither line nor column, so a reader of our own feeds it line by line and counts. */
#include "base/ini_file.h"
#include "base/text.h"

#include <errno.h>
#include <ini.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LONGEST_LINE 180
#define LONGEST_SECTION 49 /* inih cuts longer names off */

struct reader {
    FILE *file;
    struct mk_ini *ini;
    struct mk_error *err;
    const char *what;
    enum mk_ini_comments comments;
    enum mk_status status; /* first failure */
    int line;
};

static void fail(struct reader *r, const char *what)
{
    if (r->status == MK_OK)
        r->status = mk_error_at(r->err, MK_ERR_PARSE, r->ini->path, r->line, 0, "%s", what);
}

/* inih says nothing of a section that has no keys. */
static bool take_section(struct reader *r, const char *text)
{
    const char *end = strchr(text, ']');
    struct mk_ini *ini = r->ini;
    char name[LONGEST_SECTION + 1];
    if (!end || !strchr("#;", end[1 + strspn(end + 1, " \t")])) { /* its 0, too, is in a text */
        fail(r, "expected `[section]` and nothing else in the line");
        return false;
    }
    size_t length = (size_t)(end - text - 1);
    if (length > LONGEST_SECTION || ini->sections == MK_INI_ENTRIES) {
        fail(r, length > LONGEST_SECTION ? "the name of the section is longer than 49 characters"
                                         : "more than 256 sections");
        return false;
    }
    memcpy(name, text + 1, length);
    name[length] = '\0';
    for (int i = 0; i < ini->sections; i++)
        if (strcmp(ini->section[i].name, name) == 0)
            return true;
    struct mk_ini_section *s = &ini->section[ini->sections++];
    strcpy(s->name, name);
    s->line = r->line;
    return true;
}

/* What fits of a line, without its end; `length` is that of the whole line. False: the file has
 * ended. */
static bool take_line(FILE *file, char *line, size_t size, size_t *length)
{
    enum { ENDLESS = 1 << 20 }; /* as of a device */
    size_t n = 0;
    int c = getc(file);
    if (c == EOF)
        return false;
    for (; c != '\n' && c != EOF && n < ENDLESS; c = getc(file), n++)
        if (n + 1 < size)
            line[n] = (char)c;
    line[n < size ? n : size - 1] = '\0';
    *length = n;
    return true;
}

static bool begins_comment(const struct reader *r, const char *line, const char *at)
{
    if (r->comments == MK_INI_COMMENTS_ANYWHERE || at == line)
        return *at == '#' || *at == ';';
    return *at == ';' && (at[-1] == ' ' || at[-1] == '\t');
}

/* What is left of a line without comments, leading blanks and its end: inih would take an indented
 * line as the continuation of the one before. NULL: the file or what can be read of it has ended.
 */
static char *next_text(struct reader *r, char *line, size_t size)
{
    size_t length;
    if (r->status != MK_OK || !take_line(r->file, line, size, &length))
        return NULL;
    r->line++;
    char *text = line + (r->line == 1 ? mk_byte_order_mark(line, strlen(line)) : 0);
    text += strspn(text, " \t\v\f");
    char *end = text;
    while (*end && !begins_comment(r, text, end))
        end++;
    const bool cut = !*end && strlen(line) != length; /* more than a comment is missing */
    if (end > text && end[-1] == '\r')
        end--;
    *end = '\0';
    if (end - text > LONGEST_LINE || (cut && length >= size))
        fail(r, "the line is too long: at most 180 characters");
    else if (cut)
        fail(r, "a zero byte: this is no text file");
    return r->status == MK_OK ? text : NULL;
}

/* fgets for inih, which has room for a line of LONGEST_LINE. */
static char *next_line(char *out, int size, void *stream)
{
    struct reader *r = stream;
    char line[1024];
    const char *text = next_text(r, line, sizeof line);
    (void)size;
    if (!text)
        return NULL;
    if (text[0] && text[0] != '[' && !strpbrk(text, "=:")) {
        fail(r, "expected `key = value` or `[section]`");
        return NULL;
    }
    if (text[0] == '[' && !take_section(r, text))
        return NULL;
    sprintf(out, "%s\n", text);
    return out;
}

static int on_entry(void *user, const char *section, const char *key, const char *value)
{
    struct reader *r = user;
    if (r->status != MK_OK)
        return 0;
    const struct mk_ini_entry *before = mk_ini_find(r->ini, section, key);
    if (before) {
        r->status = mk_error_at(r->err, MK_ERR_PARSE, r->ini->path, r->line, 0,
                                "key '%s' is there twice in [%s]; the first is in line %d", key,
                                section, before->line);
        return 0;
    }
    if (r->ini->count == MK_INI_ENTRIES || strlen(section) >= MK_INI_TEXT ||
        strlen(key) >= MK_INI_TEXT || strlen(value) >= MK_INI_TEXT) {
        char text[96];
        snprintf(text, sizeof text, "too long for %s", r->what);
        fail(r, text);
        return 0;
    }
    struct mk_ini_entry *e = &r->ini->entry[r->ini->count++];
    strcpy(e->section, section);
    strcpy(e->key, key);
    strcpy(e->value, value);
    e->line = r->line;
    return 1;
}

static enum mk_status parse(struct reader *r)
{
    int bad = ini_parse_stream(next_line, r, on_entry, r);
    if (r->status == MK_OK && ferror(r->file))
        r->status =
            mk_error_errno(r->err, errno ? errno : EIO, r->ini->path, "cannot read %s", r->what);
    if (r->status == MK_OK && bad != 0) {
        r->line = bad > 0 ? bad : r->line;
        fail(r, "expected `key = value` or `[section]`");
    }
    return r->status;
}

enum mk_status mk_ini_read(const char *path, const char *what, enum mk_ini_comments comments,
                           struct mk_ini **out, struct mk_error *err)
{
    struct reader r = {.err = err, .what = what, .comments = comments};
    *out = NULL;
    r.file = fopen(path, "r");
    if (!r.file)
        return mk_error_errno(err, errno, path, "cannot open %s", what);
    r.ini = calloc(1, sizeof *r.ini);
    if (!r.ini) {
        fclose(r.file);
        return mk_error_at(err, MK_ERR_NOMEM, path, 0, 0, "out of memory");
    }
    r.ini->path = path;
    enum mk_status st = parse(&r);
    fclose(r.file);
    if (st == MK_OK)
        *out = r.ini;
    else
        mk_ini_free(r.ini);
    return st;
}

void mk_ini_free(struct mk_ini *ini)
{
    free(ini);
}

struct mk_ini_entry *mk_ini_find(struct mk_ini *ini, const char *section, const char *key)
{
    for (int i = 0; i < ini->count; i++)
        if (strcmp(ini->entry[i].section, section) == 0 && strcmp(ini->entry[i].key, key) == 0)
            return &ini->entry[i];
    return NULL;
}

const struct mk_ini_entry *mk_ini_first(const struct mk_ini *ini, const char *section)
{
    for (int i = 0; i < ini->count; i++)
        if (strcmp(ini->entry[i].section, section) == 0)
            return &ini->entry[i];
    return NULL;
}

enum mk_status mk_ini_refuse(const struct mk_ini *ini, const struct mk_ini_entry *e,
                             struct mk_error *err, const char *want)
{
    char comma[120];
    return mk_error_at(err, MK_ERR_PARSE, ini->path, e->line, 0, "%s = '%s': expected %s%s", e->key,
                       e->value, want, mk_comma_text(e->value, comma, sizeof comma));
}

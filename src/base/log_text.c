/* The text of a log, in memory: what both ways of writing one share. */
#include <stdlib.h>
#include <string.h>

#include "base/log_priv.h"

char *mk_lines_reserve(struct mk_lines *lines, size_t size)
{
    if (lines->failed)
        return NULL;
    if (lines->room - lines->used < size) {
        size_t room = lines->room * 2 + size;
        char *text = realloc(lines->text, room);
        if (!text) {
            lines->failed = true;
            return NULL;
        }
        lines->text = text;
        lines->room = room;
    }
    return lines->text + lines->used;
}

void mk_lines_free(struct mk_lines *lines)
{
    free(lines->text);
    *lines = (struct mk_lines){0};
}

static char *copy_one_line(char *to, const char *text)
{
    for (; *text; text++)
        *to++ = *text == '\n' || *text == '\r' ? ' ' : *text;
    return to;
}

void mk_lines_meta(struct mk_lines *lines, const char *key, const char *value)
{
    char *at = mk_lines_reserve(lines, strlen(key) + strlen(value) + 5);
    if (!at)
        return;
    *at++ = '#';
    *at++ = ' ';
    if (key[0]) { /* without a key it is a plain comment */
        at = copy_one_line(at, key);
        *at++ = ':';
        *at++ = ' ';
    }
    at = copy_one_line(at, value);
    *at++ = '\n';
    lines->used = (size_t)(at - lines->text);
}

void mk_lines_preamble(struct mk_lines *lines, const struct mk_log_meta *meta, size_t meta_count)
{
    bool versioned = false;
    for (size_t i = 0; i < meta_count; i++)
        versioned = versioned || strcmp(meta[i].key, MK_LOG_VERSION_KEY) == 0;
    if (!versioned)
        mk_lines_meta(lines, MK_LOG_VERSION_KEY, MK_LOG_VERSION);
    for (size_t i = 0; i < meta_count; i++)
        mk_lines_meta(lines, meta[i].key, meta[i].value);
}

/* A reader takes blanks off a name, and one pair of quotes. */
static bool needs_quotes(const char *name, size_t length)
{
    if (length == 0)
        return false;
    char first = name[0], last = name[length - 1];
    return first == ' ' || first == '\t' || last == ' ' || last == '\t' ||
           (length >= 2 && first == '"' && last == '"');
}

void mk_lines_names(struct mk_lines *lines, const char *const *names, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        size_t length = strlen(names[i]);
        char *at = mk_lines_reserve(lines, length + 3);
        if (!at)
            return;
        bool quoted = needs_quotes(names[i], length);
        if (quoted)
            *at++ = '"';
        memcpy(at, names[i], length);
        at += length;
        if (quoted)
            *at++ = '"';
        *at++ = i + 1 < count ? ',' : '\n';
        lines->used = (size_t)(at - lines->text);
    }
}

const char *mk_log_names_problem(const char *const *names, size_t count, const char **bad)
{
    bool timed = false;
    *bad = "";
    for (size_t i = 0; i < count; i++) {
        *bad = names[i];
        if (!names[i][0] || strpbrk(names[i], ",\r\n"))
            return "must not be empty or have a comma or a line break";
        if (i == 0 && names[i][0] == '#')
            return "must not begin with '#': the header line would be a comment";
        for (size_t k = 0; k < i; k++)
            if (strcmp(names[i], names[k]) == 0)
                return "is there twice";
        timed = timed || strcmp(names[i], "t") == 0;
    }
    *bad = "t";
    return timed ? NULL : "is missing: a log needs the time";
}

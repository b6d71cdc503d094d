/* One line of a command file or of the prompt: split into words and checked. */
#include <string.h>

#include "base/text.h"
#include "console/script/cmd.h"

static char *skip_blanks(char *at)
{
    return at + strspn(at, " \t\r");
}

static void trim_end(char *text)
{
    size_t n = strlen(text);
    while (n > 0 && strchr(" \t\r\n", text[n - 1]))
        text[--n] = '\0';
}

/* Cuts the next word off; quotes keep blanks. NULL: no more; sets *open when a quote is not closed.
 */
static char *next_word(char **at, bool *open)
{
    char *from = skip_blanks(*at), *to = from, *out = from;
    if (!*from)
        return NULL;
    char quote = '\0';
    for (; *to && (quote || !strchr(" \t\r", *to)); to++) {
        if (quote ? *to == quote : (*to == '"' || *to == '\''))
            quote = quote ? '\0' : *to;
        else
            *out++ = *to;
    }
    *open = quote != '\0';
    *at = *to ? to + 1 : to;
    *out = '\0';
    return from;
}

/* A # starts a comment at the line's beginning or after a blank, outside quotes. */
static void cut_comment(char *line)
{
    char quote = '\0';
    for (char *at = line; *at; at++) {
        if (quote ? *at == quote : (*at == '"' || *at == '\''))
            quote = quote ? '\0' : *at;
        else if (*at == '#' && !quote && (at == line || at[-1] == ' ' || at[-1] == '\t')) {
            *at = '\0';
            return;
        }
    }
}

static enum mk_status wrong_count(const struct cmd *c, struct mk_error *err)
{
    return mk_error_set(err, MK_ERR_PARSE, "usage: %s %s", c->name, c->usage);
}

/* Longer than any name of a file may be: it would be cut somewhere. Raw text is no name. */
static enum mk_status check_lengths(const struct cmd *c, const struct cmd_line *out,
                                    struct mk_error *err)
{
    for (int i = 0; i < out->argc && !c->raw; i++)
        if (strlen(out->argv[i]) >= SESSION_PATH)
            return mk_error_set(err, MK_ERR_RANGE, "%s %.40s...: %zu characters, at most %d",
                                c->name, out->argv[i], strlen(out->argv[i]), SESSION_PATH - 1);
    return MK_OK;
}

static enum mk_status unknown_command(const char *name, struct mk_error *err)
{
    struct mk_meant meant = {.word = name};
    char text[80];
    const struct cmd *c;
    for (int i = 0; (c = cmd_at(i)) != NULL; i++)
        mk_meant_try(&meant, c->name);
    return mk_error_set(err, MK_ERR_PARSE, "there is no command '%s'%s", name,
                        meant.name ? mk_meant_text(&meant, text, sizeof text)
                                   : "; `help` lists them");
}

enum mk_status cmd_parse(char *line, struct cmd_known *known, struct cmd_line *out,
                         struct mk_error *err)
{
    bool open = false;
    memset(out, 0, sizeof *out);
    cut_comment(line);
    trim_end(line);
    char *at = line, *name = next_word(&at, &open);
    if (!name)
        return MK_OK;
    const struct cmd *c = cmd_by_name(name);
    if (!c)
        return unknown_command(name, err);
    if (c->raw) {
        at = skip_blanks(at);
        if (*at)
            out->argv[out->argc++] = at;
    } else {
        char *word;
        while ((word = next_word(&at, &open)) != NULL) {
            if (out->argc == CMD_MAX_ARGS)
                return wrong_count(c, err);
            out->argv[out->argc++] = word;
        }
    }
    if (open)
        return mk_error_set(err, MK_ERR_PARSE, "a quote is not closed");
    if (out->argc < c->min_args || out->argc > c->max_args)
        return wrong_count(c, err);
    enum mk_status st = check_lengths(c, out, err);
    if (st == MK_OK && c->check)
        st = c->check(known, out->argc, out->argv, err);
    if (st == MK_OK)
        out->cmd = c;
    return st;
}

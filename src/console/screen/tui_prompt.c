#include "console/screen/tui_prompt.h"

#include <stdio.h>
#include <string.h>

#include "console/screen/tui_term.h"

void prompt_open(struct tui_prompt *p, const char *label, const char *text)
{
    p->label = label;
    snprintf(p->text, sizeof p->text, "%s", text);
    p->at = (int)strlen(p->text);
    p->back = 0;
    p->hint[0] = '\0';
}

void prompt_remember(struct tui_prompt *p, const char *line)
{
    if (!line[0] || (p->lines && strcmp(p->history[p->lines - 1], line) == 0))
        return;
    if (p->lines == PROMPT_HISTORY) {
        memmove(p->history[0], p->history[1], sizeof p->history - sizeof p->history[0]);
        p->lines--;
    }
    if (p->typed_lines < PROMPT_HISTORY)
        p->typed_lines++;
    snprintf(p->history[p->lines++], PROMPT_TEXT, "%s", line);
}

/* --- editing --------------------------------------------------------------------------------- */

static int before(const struct tui_prompt *p, int at)
{
    while (at > 0 && ((unsigned char)p->text[--at] & 0xc0) == 0x80)
        ;
    return at;
}

static int after(const struct tui_prompt *p, int at)
{
    if (p->text[at])
        at++;
    while (((unsigned char)p->text[at] & 0xc0) == 0x80)
        at++;
    return at;
}

static void cut(struct tui_prompt *p, int from, int to)
{
    memmove(p->text + from, p->text + to, strlen(p->text + to) + 1);
    p->at = from;
}

static void insert(struct tui_prompt *p, const char *text)
{
    size_t n = strlen(text), have = strlen(p->text);
    if (have + n >= sizeof p->text)
        return;
    memmove(p->text + p->at + n, p->text + p->at, have - (size_t)p->at + 1);
    memcpy(p->text + p->at, text, n);
    p->at += (int)n;
}

static int word_before(const struct tui_prompt *p)
{
    int at = p->at;
    while (at > 0 && p->text[at - 1] == ' ')
        at--;
    while (at > 0 && p->text[at - 1] != ' ')
        at--;
    return at;
}

/* step 1: older. */
static void recall(struct tui_prompt *p, int step)
{
    int back = p->back + step;
    if (back < 0 || back > p->lines)
        return;
    if (p->back == 0)
        snprintf(p->typed, sizeof p->typed, "%s", p->text);
    p->back = back;
    snprintf(p->text, sizeof p->text, "%s", back ? p->history[p->lines - back] : p->typed);
    p->at = (int)strlen(p->text);
}

static void complete_word(struct tui_prompt *p, const struct host_status *status)
{
    char common[PROMPT_TEXT];
    int count = complete(p->text, p->at, status, common, sizeof common, p->hint, sizeof p->hint);
    if (count == 0)
        return;
    int from = p->at;
    while (from > 0 && p->text[from - 1] != ' ')
        from--;
    cut(p, from, p->at);
    insert(p, common);
    size_t n = strlen(common);
    if (count == 1) {
        if (n && common[n - 1] != '/')
            insert(p, " ");
        p->hint[0] = '\0';
    }
}

static void edit(struct tui_prompt *p, int key)
{
    switch (key) {
    case TK_LEFT:
    case TK_CTRL('b'):
        p->at = before(p, p->at);
        break;
    case TK_RIGHT:
    case TK_CTRL('f'):
        p->at = after(p, p->at);
        break;
    case TK_HOME:
    case TK_CTRL('a'):
        p->at = 0;
        break;
    case TK_END:
    case TK_CTRL('e'):
        p->at = (int)strlen(p->text);
        break;
    case TK_ERASE:
        cut(p, before(p, p->at), p->at);
        break;
    case TK_DELETE:
    case TK_CTRL('d'):
        cut(p, p->at, after(p, p->at));
        break;
    case TK_CTRL('u'):
        cut(p, 0, p->at);
        break;
    case TK_CTRL('k'):
        p->text[p->at] = '\0';
        break;
    case TK_CTRL('w'):
        cut(p, word_before(p), p->at);
        break;
    default:
        break;
    }
}

/* A character of a text: no control character, no half of a surrogate pair. */
static bool is_text(int key)
{
    return key >= ' ' && key < 0x110000 && key != TK_ERASE && !(key >= 0xd800 && key < 0xe000);
}

static bool leaves(const struct tui_prompt *p, int key)
{
    return key == TK_ESCAPE || key == TK_CTRL('c') || (key == TK_ERASE && !p->text[0]);
}

enum prompt_answer prompt_key(struct tui_prompt *p, int key, const struct host_status *status)
{
    char typed[5];
    if (key == TK_RETURN)
        return PROMPT_DONE;
    if (leaves(p, key))
        return PROMPT_LEFT;
    if (key == TK_TAB) {
        complete_word(p, status);
        return PROMPT_GOES_ON;
    }
    p->hint[0] = '\0';
    if (key == TK_UP || key == TK_CTRL('p')) {
        recall(p, 1);
    } else if (key == TK_DOWN || key == TK_CTRL('n')) {
        recall(p, -1);
    } else if (is_text(key)) {
        tui_encode((uint32_t)key, typed);
        insert(p, typed);
    } else {
        edit(p, key);
    }
    return PROMPT_GOES_ON;
}

/* --- drawing --------------------------------------------------------------------------------- */

void prompt_draw(const struct tui_prompt *p, struct canvas *c, int row)
{
    char hint[PROMPT_TEXT] = "";
    int col = canvas_text(c, row, 0, c->cols, STYLE_KEY, p->label);
    int room = c->cols - col - 1, cursor = 0;
    for (const char *s = p->text; s < p->text + p->at; cursor++)
        tui_decode(&s);
    /* A line that is too long is shown from where its cursor stays in view. */
    const char *from = p->text;
    for (int skip = cursor - room; skip > 0; skip--, cursor--)
        tui_decode(&from);
    canvas_text(c, row, col, room + 1, STYLE_VALUE, from);
    c->cursor_row = row;
    c->cursor_col = col + cursor;
    if (p->hint[0])
        snprintf(hint, sizeof hint, "%s", p->hint);
    else
        complete_usage(p->text, hint, sizeof hint);
    canvas_text(c, row - 1, 1, c->cols - 1, STYLE_DIM, hint);
}

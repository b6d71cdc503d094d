/* The state of the screen as every part of it changes it: what is open, what is asked of the
 * session. */
#include <stdarg.h>
#include <stdio.h>

#include "console/screen/tui.h"

void tui_post(struct tui *t, const char *fmt, ...)
{
    char line[1000];
    va_list args;
    va_start(args, fmt);
    vsnprintf(line, sizeof line, fmt, args);
    va_end(args);
    t->door.post(t->door.user, line);
}

struct scope *tui_scope_in_view(struct tui *t)
{
    return t->in_log ? &t->log : &t->live;
}

int tui_setup_count(void)
{
    int n = 0;
    while (mk_ctrl_setup(n))
        n++;
    return n;
}

void tui_open_setup(struct tui *t)
{
    t->mode = MODE_SETUP;
    for (int i = 0; i < tui_setup_count(); i++)
        if (mk_ctrl_setup(i) == t->status.setup)
            t->chosen = i;
}

void tui_open_prompt(struct tui *t, const char *label, const char *text)
{
    prompt_open(&t->prompt, label, text);
    t->mode = MODE_PROMPT;
    t->blank_typed = false;
}

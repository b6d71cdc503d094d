/* The terminal: the only part that knows curses. One per process. */
#ifndef MECHKIT_CONSOLE_SCREEN_TUI_TERM_H
#define MECHKIT_CONSOLE_SCREEN_TUI_TERM_H

#include "console/screen/tui_canvas.h"

/* Keys that are no characters; characters are their Unicode number, control keys 1 .. 31. */
enum tui_key {
    TK_NONE = -1,
    TK_GONE = -2, /* the terminal is no more */
    TK_ESCAPE = 27,
    TK_RETURN = 13,
    TK_TAB = 9,
    TK_ERASE = 127,
    TK_LEFT = 0x110000,
    TK_RIGHT,
    TK_UP,
    TK_DOWN,
    TK_HOME,
    TK_END,
    TK_PAGE_UP,
    TK_PAGE_DOWN,
    TK_DELETE,
    TK_BACK_TAB
};
#define TK_CTRL(letter) ((letter)&0x1f)

struct term_options {
    bool mono;  /* no colours even if there are */
    bool ascii; /* no characters beyond ASCII */
};

/* Takes the terminal over. MK_ERR_NOTSUP: standard output or input is none, or an unknown one. */
MK_NODISCARD enum mk_status term_open(const struct term_options *options, struct mk_error *err);
/* Gives it back as it was. Harmless twice. */
void term_close(void);
/* The same from a signal handler of a crash: a few system calls, no memory. */
void term_restore_in_crash(void);
bool term_unicode(void);

/* Current size; changes are taken over. */
void term_size(int *rows, int *cols);
void term_show(const struct canvas *c);
/* Draws everything anew at the next term_show. */
void term_redraw(void);
/* Next key, waiting at most timeout_ms. */
int term_key(int timeout_ms);
/* Stops the process until it is continued (Ctrl-Z); the terminal belongs to the shell meanwhile. */
void term_suspend(void);

#endif

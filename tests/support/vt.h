/* A small terminal: understands what curses writes for TERM=xterm-256color and keeps the screen. */
#ifndef MECHKIT_TESTS_SUPPORT_VT_H
#define MECHKIT_TESTS_SUPPORT_VT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct vt_cell {
    uint32_t ch;
    int16_t fg, bg; /* -1: the terminal's own; else 0..255 */
    bool bold, dim, reverse, underline;
};

struct vt {
    int rows, cols;
    struct vt_cell *cell;
    int row, col, saved_row, saved_col;
    bool wrap_next;
    int top, bottom; /* scrolling region */
    struct vt_cell pen;
    bool cursor_shown, alternate;
    uint32_t last; /* character written last, for REP */
    /* Parser: */
    int state;
    char sequence[64];
    int length;
    uint32_t utf8;
    int utf8_left;
    unsigned unknown; /* sequences that it does not know */
};

void vt_init(struct vt *t, int rows, int cols);
void vt_free(struct vt *t);
void vt_resize(struct vt *t, int rows, int cols);
void vt_write(struct vt *t, const char *bytes, size_t count);
/* The screen as UTF-8, lines ended by newlines, blanks at their ends cut; to free. */
char *vt_text(const struct vt *t);

#endif

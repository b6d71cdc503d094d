/* What the screen draws on: a grid of characters with a style each. It knows no terminal, so the
 * same pictures go to curses, to tests and to files. Everything clips at the edges. */
#ifndef MECHKIT_CONSOLE_SCREEN_TUI_CANVAS_H
#define MECHKIT_CONSOLE_SCREEN_TUI_CANVAS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mechkit/status.h"

/* What something is; the terminal decides how that looks, with and without colours. */
enum tui_style {
    STYLE_NORMAL,
    STYLE_DIM,   /* frames, axes, units */
    STYLE_TITLE, /* headings of panels */
    STYLE_BAR,   /* title bar */
    STYLE_VALUE, /* numbers that matter */
    STYLE_GOOD,
    STYLE_WARN,
    STYLE_BAD,
    STYLE_KEY,      /* a key that can be pressed */
    STYLE_SELECTED, /* row of a list */
    STYLE_TRACE_A,  /* first joint */
    STYLE_TRACE_B,  /* second joint */
    STYLE_TRACE_C,  /* command */
    STYLE_TRACE_D,  /* what a model predicts, references */
    STYLE_COUNT
};

struct tui_cell {
    uint32_t ch; /* Unicode; only ASCII on a canvas that is not `unicode` */
    uint8_t style;
};

struct canvas {
    int rows, cols;
    bool unicode;
    struct tui_cell *cell;
    int cursor_row, cursor_col; /* of the text cursor; -1: hidden */
};

struct tui_rect {
    int row, col, rows, cols;
};

/* Empties the canvas at a new size. MK_ERR_NOMEM leaves it without cells, which is harmless. */
MK_NODISCARD enum mk_status canvas_resize(struct canvas *c, int rows, int cols);
void canvas_clear(struct canvas *c);
void canvas_free(struct canvas *c);

void canvas_put(struct canvas *c, int row, int col, uint32_t ch, enum tui_style style);
/* Text (UTF-8) in at most `width` columns; returns the column after it. */
int canvas_text(struct canvas *c, int row, int col, int width, enum tui_style style,
                const char *text);
int canvas_print(struct canvas *c, int row, int col, int width, enum tui_style style,
                 const char *fmt, ...) MK_PRINTF(6, 7);
void canvas_fill(struct canvas *c, struct tui_rect r, uint32_t ch, enum tui_style style);
/* Frame with a title (may be NULL) in its upper edge; returns what is inside. */
struct tui_rect canvas_frame(struct canvas *c, struct tui_rect r, const char *title);
/* A rule across a frame, joined to its sides. */
void canvas_rule(struct canvas *c, struct tui_rect frame, int row, const char *title);
/* Text in lines of at most r.cols, broken at blanks; returns the number of lines needed. */
int canvas_wrap(struct canvas *c, struct tui_rect r, enum tui_style style, const char *text);

/* Columns that UTF-8 text takes (every character is taken to be one column wide). */
int tui_columns(const char *text);
/* Next character of UTF-8 text, *at advanced; U+FFFD for what is none. */
uint32_t tui_decode(const char **at);
/* UTF-8 of ch into buf (5 bytes), terminated; returns its length. */
int tui_encode(uint32_t ch, char *buf);

/* --- dots ------------------------------------------------------------------------------------ */

/* A finer grid: 2 x 4 dots a character, about square. Shown in Braille, or by the ASCII character
 * of the most similar shape. */
struct dots {
    int rows, cols; /* in characters */
    uint8_t *bits;
    uint8_t *style;
};

MK_NODISCARD enum mk_status dots_init(struct dots *d, int rows, int cols);
void dots_free(struct dots *d);
void dots_set(struct dots *d, int x, int y, enum tui_style style); /* y down */
void dots_line(struct dots *d, double x0, double y0, double x1, double y1, enum tui_style style);
void dots_circle(struct dots *d, double x, double y, double radius, enum tui_style style);
void dots_show(const struct dots *d, struct canvas *c, int row, int col);

#endif

#include "console/screen/tui_canvas.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* --- UTF-8 ----------------------------------------------------------------------------------- */

uint32_t tui_decode(const char **at)
{
    const unsigned char *s = (const unsigned char *)*at;
    int more = s[0] < 0x80 ? 0 : (s[0] & 0xe0) == 0xc0 ? 1 : (s[0] & 0xf0) == 0xe0 ? 2 : 3;
    uint32_t ch = more == 0 ? s[0] : s[0] & (0x3fu >> more);
    if (s[0] >= 0x80 && (s[0] < 0xc2 || s[0] > 0xf4))
        more = 0, ch = 0xfffd;
    for (int i = 1; i <= more; i++) {
        if ((s[i] & 0xc0) != 0x80) {
            *at += i;
            return 0xfffd;
        }
        ch = ch << 6 | (s[i] & 0x3fu);
    }
    *at += 1 + more;
    return ch;
}

int tui_encode(uint32_t ch, char *buf)
{
    int n = ch < 0x80 ? 1 : ch < 0x800 ? 2 : ch < 0x10000 ? 3 : 4;
    static const unsigned char lead[] = {0, 0, 0xc0, 0xe0, 0xf0};
    for (int i = n - 1; i > 0; i--, ch >>= 6)
        buf[i] = (char)(0x80 | (ch & 0x3f));
    buf[0] = (char)(lead[n] | ch);
    buf[n] = '\0';
    return n;
}

int tui_columns(const char *text)
{
    int n = 0;
    while (*text) {
        tui_decode(&text);
        n++;
    }
    return n;
}

/* --- cells ----------------------------------------------------------------------------------- */

enum mk_status canvas_resize(struct canvas *c, int rows, int cols)
{
    free(c->cell);
    c->rows = c->cols = 0;
    c->cell = calloc((size_t)rows * (size_t)cols + 1, sizeof *c->cell);
    if (!c->cell)
        return MK_ERR_NOMEM;
    c->rows = rows;
    c->cols = cols;
    canvas_clear(c);
    return MK_OK;
}

void canvas_clear(struct canvas *c)
{
    for (int i = 0; i < c->rows * c->cols; i++)
        c->cell[i] = (struct tui_cell){' ', STYLE_NORMAL};
    c->cursor_row = c->cursor_col = -1;
}

void canvas_free(struct canvas *c)
{
    free(c->cell);
    c->cell = NULL;
    c->rows = c->cols = 0;
}

/* The nearest that a plain terminal has. */
static uint32_t plain(uint32_t ch)
{
    static const struct {
        uint32_t from, to;
    } rows[] = {{0x2500, '-'}, {0x2501, '='}, {0x2502, '|'}, {0x2503, '|'}, {0x2588, '#'},
                {0x2591, '.'}, {0x2592, ':'}, {0x2190, '<'}, {0x2191, '^'}, {0x2192, '>'},
                {0x2193, 'v'}, {0x00b7, '.'}, {0x25cf, '*'}, {0x25cb, 'o'}, {0x25b6, '>'},
                {0x2026, '~'}, {0x2713, 'x'}, {0x2717, '!'}, {0x00b0, 'd'}, {0x00b5, 'u'},
                {0x2013, '-'}, {0x00b1, '~'}, {0x258f, '|'}, {0x2595, '|'}, {0x25b2, '^'},
                {0x25bc, 'v'}, {0x2248, '~'}, {0x23f8, '='}, {0x25a0, '#'}, {0x00d7, 'x'},
                {0x2022, '*'}, {0x2032, 39},  {0x00a0, ' '}};
    if (ch < 0x7f)
        return ch;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        if (rows[i].from == ch)
            return rows[i].to;
    return ch >= 0x250c && ch <= 0x254b ? '+' : '?';
}

void canvas_put(struct canvas *c, int row, int col, uint32_t ch, enum tui_style style)
{
    if (row < 0 || col < 0 || row >= c->rows || col >= c->cols)
        return;
    if (ch < ' ' || ch == 0x7f) /* nothing may steer the terminal */
        ch = '?';
    c->cell[row * c->cols + col] = (struct tui_cell){c->unicode ? ch : plain(ch), (uint8_t)style};
}

int canvas_text(struct canvas *c, int row, int col, int width, enum tui_style style,
                const char *text)
{
    for (; *text && width > 0; width--)
        canvas_put(c, row, col++, tui_decode(&text), style);
    return col;
}

int canvas_print(struct canvas *c, int row, int col, int width, enum tui_style style,
                 const char *fmt, ...)
{
    char text[512];
    va_list args;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    return canvas_text(c, row, col, width, style, text);
}

void canvas_fill(struct canvas *c, struct tui_rect r, uint32_t ch, enum tui_style style)
{
    for (int i = 0; i < r.rows; i++)
        for (int j = 0; j < r.cols; j++)
            canvas_put(c, r.row + i, r.col + j, ch, style);
}

static void title(struct canvas *c, int row, int col, int width, const char *text)
{
    if (!text || width < 3)
        return;
    col = canvas_text(c, row, col, 1, STYLE_NORMAL, " ");
    col = canvas_text(c, row, col, width - 2, STYLE_TITLE, text);
    canvas_text(c, row, col, 1, STYLE_NORMAL, " ");
}

struct tui_rect canvas_frame(struct canvas *c, struct tui_rect r, const char *text)
{
    int bottom = r.row + r.rows - 1, right = r.col + r.cols - 1;
    for (int j = r.col + 1; j < right; j++) {
        canvas_put(c, r.row, j, 0x2500, STYLE_DIM);
        canvas_put(c, bottom, j, 0x2500, STYLE_DIM);
    }
    for (int i = r.row + 1; i < bottom; i++) {
        canvas_put(c, i, r.col, 0x2502, STYLE_DIM);
        canvas_put(c, i, right, 0x2502, STYLE_DIM);
    }
    canvas_put(c, r.row, r.col, 0x250c, STYLE_DIM);
    canvas_put(c, r.row, right, 0x2510, STYLE_DIM);
    canvas_put(c, bottom, r.col, 0x2514, STYLE_DIM);
    canvas_put(c, bottom, right, 0x2518, STYLE_DIM);
    title(c, r.row, r.col + 1, r.cols - 2, text);
    return (struct tui_rect){r.row + 1, r.col + 1, r.rows - 2, r.cols - 2};
}

void canvas_rule(struct canvas *c, struct tui_rect frame, int row, const char *text)
{
    for (int j = 1; j < frame.cols - 1; j++)
        canvas_put(c, row, frame.col + j, 0x2500, STYLE_DIM);
    canvas_put(c, row, frame.col, 0x251c, STYLE_DIM);
    canvas_put(c, row, frame.col + frame.cols - 1, 0x2524, STYLE_DIM);
    title(c, row, frame.col + 1, frame.cols - 2, text);
}

int canvas_wrap(struct canvas *c, struct tui_rect r, enum tui_style style, const char *text)
{
    int line = 0;
    while (*text && r.cols > 0) {
        const char *at = text, *blank = NULL;
        int n = 0;
        while (*at && *at != '\n' && n < r.cols) {
            if (*at == ' ')
                blank = at;
            tui_decode(&at);
            n++;
        }
        if (*at && *at != '\n' && *at != ' ' && blank)
            at = blank;
        if (line < r.rows) {
            int col = r.col;
            for (const char *s = text; s < at;)
                canvas_put(c, r.row + line, col++, tui_decode(&s), style);
        }
        line++;
        text = at + (*at == '\n' || *at == ' ');
    }
    return line;
}

/* --- dots ------------------------------------------------------------------------------------ */

enum mk_status dots_init(struct dots *d, int rows, int cols)
{
    *d = (struct dots){0, 0, NULL, NULL};
    if (rows <= 0 || cols <= 0)
        return MK_OK;
    d->bits = calloc(2, (size_t)rows * (size_t)cols);
    if (!d->bits)
        return MK_ERR_NOMEM;
    d->style = d->bits + (size_t)rows * (size_t)cols;
    d->rows = rows;
    d->cols = cols;
    return MK_OK;
}

void dots_free(struct dots *d)
{
    free(d->bits);
    *d = (struct dots){0, 0, NULL, NULL};
}

void dots_set(struct dots *d, int x, int y, enum tui_style style)
{
    /* Braille numbers its dots by columns, the lowest row last. */
    static const uint8_t bit[4][2] = {{0x01, 0x08}, {0x02, 0x10}, {0x04, 0x20}, {0x40, 0x80}};
    if (x < 0 || y < 0 || x >= 2 * d->cols || y >= 4 * d->rows)
        return;
    int at = y / 4 * d->cols + x / 2;
    d->bits[at] |= bit[y % 4][x % 2];
    d->style[at] = (uint8_t)style;
}

static double magnitude(double x)
{
    return x < 0.0 ? -x : x;
}

void dots_line(struct dots *d, double x0, double y0, double x1, double y1, enum tui_style style)
{
    double dx = x1 - x0, dy = y1 - y0, span = magnitude(dx);
    if (magnitude(dy) > span)
        span = magnitude(dy);
    if (!(span < 1e5)) /* NaN as well */
        return;
    int steps = (int)span + 1;
    for (int i = 0; i <= steps; i++) {
        double x = x0 + dx * i / steps, y = y0 + dy * i / steps;
        if (x > -1.0 && y > -1.0)
            dots_set(d, (int)(x + 0.5), (int)(y + 0.5), style);
    }
}

void dots_circle(struct dots *d, double x, double y, double radius, enum tui_style style)
{
    /* A polygon with corners closer than dots; cos and sin by rotation. */
    enum { CORNERS = 48 };
    const double c = 0.991444861373810411, s = 0.130526192220051591;
    double ux = radius, uy = 0.0;
    for (int i = 0; i < CORNERS; i++) {
        double vx = c * ux - s * uy, vy = s * ux + c * uy;
        dots_line(d, x + ux, y + uy, x + vx, y + vy, style);
        ux = vx, uy = vy;
    }
}

static int bit_count(unsigned bits)
{
    int n = 0;
    for (; bits; bits &= bits - 1)
        n++;
    return n;
}

/* Shapes of characters in a grid of 2 x 4. */
static uint32_t similar_ascii(uint8_t bits)
{
    static const struct {
        uint8_t bits;
        char ch;
    } shape[] = {{0x40, '.'}, {0x80, '.'},  {0xc0, '_'},  {0x24, '-'},  {0x12, '-'}, {0x09, '"'},
                 {0x01, '`'}, {0x08, '\''}, {0x03, '\''}, {0x18, '\''}, {0x47, '|'}, {0xb8, '|'},
                 {0x78, '/'}, {0x5a, '/'},  {0x87, '\\'}, {0xa3, '\\'}, {0x1c, '/'}, {0x23, '\\'},
                 {0x06, ':'}, {0x30, ':'},  {0xe4, '='},  {0xff, '#'},  {0x3f, '#'}, {0xfc, '#'},
                 {0x04, '-'}, {0x20, '-'},  {0x02, '-'},  {0x10, '-'},  {0x44, ','}, {0xa0, ','},
                 {0x1b, '^'}, {0xe0, '.'},  {0xc4, '.'}};
    int best = 99;
    char ch = '*';
    for (size_t i = 0; i < sizeof shape / sizeof shape[0]; i++) {
        int off = bit_count(shape[i].bits ^ bits);
        if (off < best) {
            best = off;
            ch = shape[i].ch;
        }
    }
    return (uint32_t)ch;
}

void dots_show(const struct dots *d, struct canvas *c, int row, int col)
{
    for (int i = 0; i < d->rows; i++)
        for (int j = 0; j < d->cols; j++) {
            uint8_t bits = d->bits[i * d->cols + j];
            if (bits)
                canvas_put(c, row + i, col + j, c->unicode ? 0x2800u + bits : similar_ascii(bits),
                           d->style[i * d->cols + j]);
        }
}

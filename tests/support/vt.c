#include "support/vt.h"

#include <stdlib.h>
#include <string.h>

enum { GROUND, ESCAPE, CSI, STRING, CHARSET };

static const struct vt_cell blank = {.ch = ' ', .fg = -1, .bg = -1};

static struct vt_cell *at(struct vt *t, int row, int col)
{
    return &t->cell[row * t->cols + col];
}

static int clamp(int x, int low, int high)
{
    return x < low ? low : x > high ? high : x;
}

/* Erased cells take the pen's background. */
static void erase(struct vt *t, int row, int from, int to)
{
    struct vt_cell c = blank;
    c.bg = t->pen.bg;
    for (int j = clamp(from, 0, t->cols); j < clamp(to, 0, t->cols); j++)
        *at(t, row, j) = c;
}

void vt_init(struct vt *t, int rows, int cols)
{
    memset(t, 0, sizeof *t);
    t->pen = blank;
    t->cursor_shown = true;
    vt_resize(t, rows, cols);
}

void vt_free(struct vt *t)
{
    free(t->cell);
    t->cell = NULL;
}

void vt_resize(struct vt *t, int rows, int cols)
{
    struct vt_cell *cell = malloc((size_t)rows * (size_t)cols * sizeof *cell);
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++)
            cell[i * cols + j] = t->cell && i < t->rows && j < t->cols ? *at(t, i, j) : blank;
    free(t->cell);
    t->cell = cell;
    t->rows = rows;
    t->cols = cols;
    t->top = 0;
    t->bottom = rows - 1;
    t->row = clamp(t->row, 0, rows - 1);
    t->col = clamp(t->col, 0, cols - 1);
    t->wrap_next = false;
}

/* Lines from..bottom move by n: up for n > 0. */
static void scroll(struct vt *t, int from, int n)
{
    int count = t->bottom - from + 1;
    int m = clamp(n < 0 ? -n : n, 0, count);
    size_t row = (size_t)t->cols * sizeof *t->cell;
    struct vt_cell *first = at(t, from, 0);
    if (n > 0)
        memmove(first, first + t->cols * m, row * (size_t)(count - m));
    else
        memmove(first + t->cols * m, first, row * (size_t)(count - m));
    for (int i = 0; i < m; i++)
        erase(t, n > 0 ? t->bottom - i : from + i, 0, t->cols);
}

static void line_feed(struct vt *t)
{
    if (t->row == t->bottom)
        scroll(t, t->top, 1);
    else
        t->row = clamp(t->row + 1, 0, t->rows - 1);
}

static void put(struct vt *t, uint32_t ch)
{
    if (t->wrap_next) {
        t->col = 0;
        line_feed(t);
        t->wrap_next = false;
    }
    struct vt_cell c = t->pen;
    c.ch = ch;
    *at(t, t->row, t->col) = c;
    t->last = ch;
    if (t->col == t->cols - 1)
        t->wrap_next = true;
    else
        t->col++;
}

static void control(struct vt *t, int ch)
{
    t->wrap_next = false;
    if (ch == '\n' || ch == 11 || ch == 12)
        line_feed(t);
    else if (ch == '\r')
        t->col = 0;
    else if (ch == '\b')
        t->col = clamp(t->col - 1, 0, t->cols - 1);
    else if (ch == '\t')
        t->col = clamp((t->col / 8 + 1) * 8, 0, t->cols - 1);
}

static void set_colour(struct vt *t, const int *p, int *i, int n, bool background)
{
    int16_t colour = -1;
    if (*i + 2 < n && p[*i + 1] == 5) {
        colour = (int16_t)p[*i + 2];
        *i += 2;
    }
    *(background ? &t->pen.bg : &t->pen.fg) = colour;
}

static void set_pen(struct vt *t, const int *p, int n)
{
    for (int i = 0; i < n; i++) {
        int k = p[i];
        if (k == 0)
            t->pen = blank;
        else if (k == 1)
            t->pen.bold = true;
        else if (k == 2)
            t->pen.dim = true;
        else if (k == 4)
            t->pen.underline = true;
        else if (k == 7)
            t->pen.reverse = true;
        else if (k == 22)
            t->pen.bold = t->pen.dim = false;
        else if (k == 24)
            t->pen.underline = false;
        else if (k == 27)
            t->pen.reverse = false;
        else if (k >= 30 && k <= 37)
            t->pen.fg = (int16_t)(k - 30);
        else if (k >= 40 && k <= 47)
            t->pen.bg = (int16_t)(k - 40);
        else if (k >= 90 && k <= 97)
            t->pen.fg = (int16_t)(k - 90 + 8);
        else if (k == 39)
            t->pen.fg = -1;
        else if (k == 49)
            t->pen.bg = -1;
        else if (k == 38 || k == 48)
            set_colour(t, p, &i, n, k == 48);
        else
            t->unknown++;
    }
}

static void clear_screen(struct vt *t, int kind)
{
    int here = t->row;
    if (kind == 0)
        erase(t, here, t->col, t->cols);
    else if (kind == 1)
        erase(t, here, 0, t->col + 1);
    for (int i = 0; i < t->rows; i++)
        if (kind >= 2 || (kind == 0 && i > here) || (kind == 1 && i < here))
            erase(t, i, 0, t->cols);
}

static void move_cells(struct vt *t, int n, bool insert)
{
    struct vt_cell *from = at(t, t->row, t->col);
    int room = t->cols - t->col;
    n = clamp(n, 0, room);
    size_t keep = (size_t)(room - n) * sizeof *from;
    if (insert)
        memmove(from + n, from, keep);
    else
        memmove(from, from + n, keep);
    if (insert)
        erase(t, t->row, t->col, t->col + n);
    else
        erase(t, t->row, t->cols - n, t->cols);
}

static void set_mode(struct vt *t, const char *sequence, bool on)
{
    if (strncmp(sequence, "?25", 3) == 0) {
        t->cursor_shown = on;
    } else if (strncmp(sequence, "?1049", 5) == 0) {
        t->alternate = on;
        clear_screen(t, 2);
    }
}

static void csi(struct vt *t, char final)
{
    int p[16] = {0}, n = 0;
    char *s = t->sequence;
    for (s += *s == '?'; *s && n < 16; n++) {
        p[n] = (int)strtol(s, &s, 10);
        s += *s == ';' || *s == ':';
    }
    int a = p[0] ? p[0] : 1;
    if (!strchr("hlmr", final) && final != 'b')
        t->wrap_next = false;
    switch (final) {
    case 'H':
    case 'f':
        t->row = clamp(a - 1, 0, t->rows - 1);
        t->col = clamp((p[1] ? p[1] : 1) - 1, 0, t->cols - 1);
        break;
    case 'A':
        t->row = clamp(t->row - a, 0, t->rows - 1);
        break;
    case 'B':
        t->row = clamp(t->row + a, 0, t->rows - 1);
        break;
    case 'C':
        t->col = clamp(t->col + a, 0, t->cols - 1);
        break;
    case 'D':
        t->col = clamp(t->col - a, 0, t->cols - 1);
        break;
    case 'G':
        t->col = clamp(a - 1, 0, t->cols - 1);
        break;
    case 'd':
        t->row = clamp(a - 1, 0, t->rows - 1);
        break;
    case 'J':
        clear_screen(t, p[0]);
        break;
    case 'K':
        erase(t, t->row, p[0] == 0 ? t->col : 0, p[0] == 1 ? t->col + 1 : t->cols);
        break;
    case 'X':
        erase(t, t->row, t->col, t->col + a);
        break;
    case '@':
        move_cells(t, a, true);
        break;
    case 'P':
        move_cells(t, a, false);
        break;
    case 'L':
        scroll(t, t->row, -a);
        break;
    case 'M':
        scroll(t, t->row, a);
        break;
    case 'S':
        scroll(t, t->top, a);
        break;
    case 'T':
        scroll(t, t->top, -a);
        break;
    case 'b':
        for (int k = 0; k < a; k++)
            put(t, t->last);
        break;
    case 'm':
        set_pen(t, p, n ? n : 1);
        break;
    case 'r':
        t->top = clamp(a - 1, 0, t->rows - 1);
        t->bottom = clamp((p[1] ? p[1] : t->rows) - 1, t->top, t->rows - 1);
        t->row = t->col = 0;
        break;
    case 'h':
    case 'l':
        set_mode(t, t->sequence, final == 'h');
        break;
    case 't':
        break;
    default:
        t->unknown++;
        break;
    }
}

static void escape(struct vt *t, unsigned char ch)
{
    t->state = GROUND;
    if (ch == '[') {
        t->state = CSI;
        t->length = 0;
        t->sequence[0] = '\0';
    } else if (ch == '(' || ch == ')') {
        t->state = CHARSET;
    } else if (ch == ']' || ch == 'P') {
        t->state = STRING;
    } else if (ch == 'M') {
        if (t->row == t->top)
            scroll(t, t->top, -1);
        else
            t->row--;
    } else if (ch == '7') {
        t->saved_row = t->row, t->saved_col = t->col;
    } else if (ch == '8') {
        t->row = clamp(t->saved_row, 0, t->rows - 1);
        t->col = clamp(t->saved_col, 0, t->cols - 1);
    } else if (!strchr("=>", ch)) {
        t->unknown++;
    }
}

static void ground(struct vt *t, unsigned char ch)
{
    if (t->utf8_left > 0 && (ch & 0xc0) == 0x80) {
        t->utf8 = t->utf8 << 6 | (ch & 0x3f);
        if (--t->utf8_left == 0)
            put(t, t->utf8);
    } else if (ch == 27) {
        t->state = ESCAPE;
    } else if (ch < 32 || ch == 127) {
        control(t, ch);
    } else if (ch < 128) {
        put(t, ch);
    } else {
        t->utf8_left = ch >= 0xf0 ? 3 : ch >= 0xe0 ? 2 : 1;
        t->utf8 = ch & (0x3fu >> t->utf8_left);
    }
}

void vt_write(struct vt *t, const char *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        unsigned char ch = (unsigned char)bytes[i];
        if (t->state == GROUND) {
            ground(t, ch);
        } else if (t->state == ESCAPE) {
            escape(t, ch);
        } else if (t->state == CHARSET) {
            t->state = GROUND;
        } else if (t->state == STRING) {
            t->state = ch == 7 || ch == '\\' ? GROUND : STRING;
        } else if (ch >= 0x40 && ch <= 0x7e) {
            t->state = GROUND;
            csi(t, (char)ch);
        } else if (t->length + 1 < (int)sizeof t->sequence) {
            t->sequence[t->length++] = (char)ch;
            t->sequence[t->length] = '\0';
        }
    }
}

static size_t encode(uint32_t ch, char *out)
{
    if (ch < 0x80) {
        out[0] = (char)ch;
        return 1;
    }
    size_t n = ch < 0x800 ? 2 : ch < 0x10000 ? 3 : 4;
    for (size_t i = n; i-- > 1; ch >>= 6)
        out[i] = (char)(0x80 | (ch & 0x3f));
    out[0] = (char)((n == 2 ? 0xc0 : n == 3 ? 0xe0 : 0xf0) | ch);
    return n;
}

char *vt_text(const struct vt *t)
{
    char *text = malloc((size_t)t->rows * ((size_t)t->cols * 4 + 1) + 1), *out = text;
    for (int i = 0; i < t->rows; i++) {
        char *end = out;
        for (int j = 0; j < t->cols; j++) {
            uint32_t ch = t->cell[i * t->cols + j].ch;
            out += encode(ch, out);
            if (ch != ' ')
                end = out;
        }
        out = end;
        *out++ = '\n';
    }
    *out = '\0';
    return text;
}

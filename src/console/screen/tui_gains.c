#include "console/screen/tui_gains.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "console/screen/tui.h"
#include "mechkit/number.h"

void gains_open(struct tui *t)
{
    struct tui_gains *g = &t->gains;
    if (g->setup != t->status.setup)
        *g = (struct tui_gains){.setup = t->status.setup};
    g->edit[0] = g->note[0] = '\0';
    g->sure = false;
}

/* --- values ---------------------------------------------------------------------------------- */

static double value_of(const struct tui *t, int i)
{
    return t->gains.pending[i] ? t->gains.value[i] : t->status.value[i];
}

static void all_values(const struct tui *t, double *out)
{
    for (int i = 0; i < t->gains.setup->param_count; i++)
        out[i] = value_of(t, i);
}

static bool anything_pending(const struct tui_gains *g)
{
    for (int i = 0; i < g->setup->param_count; i++)
        if (g->pending[i])
            return true;
    return false;
}

static void put(struct tui *t, int row, double value)
{
    struct tui_gains *g = &t->gains;
    struct mk_error err = MK_ERROR_INIT;
    g->sure = false;
    if (mk_ctrl_check(g->setup, row, value, &err) != MK_OK) {
        snprintf(g->note, sizeof g->note, "%.119s", err.message);
        return;
    }
    g->value[row] = value;
    g->pending[row] = value != t->status.value[row];
    g->note[0] = '\0';
}

static void take_edit(struct tui *t)
{
    struct tui_gains *g = &t->gains;
    double x;
    if (!g->edit[0])
        return;
    if (mk_parse_double_z(g->edit, &x) && isfinite(x))
        put(t, g->row, x);
    else
        snprintf(g->note, sizeof g->note, "'%s' is not a number", g->edit);
    g->edit[0] = '\0';
}

/* --- sending --------------------------------------------------------------------------------- */

static void number(char *buf, size_t size, double x)
{
    for (int digits = 6; digits <= 17; digits++) {
        double back;
        snprintf(buf, size, "%.*g", digits, x);
        if (mk_parse_double_z(buf, &back) && back == x)
            return;
    }
}

static int pending_gains(const struct tui_gains *g)
{
    int n = 0;
    for (int i = 0; i < g->setup->param_count; i++)
        n += g->setup->param[i].gain && g->pending[i];
    return n;
}

/* In one command: they take effect between two samples, together. */
static void send_gains(struct tui *t)
{
    char line[900] = "gains", text[40];
    const struct mk_ctrl_ops *ops = t->gains.setup;
    for (int i = 0; i < ops->param_count; i++) {
        if (!ops->param[i].gain)
            continue;
        number(text, sizeof text, value_of(t, i));
        size_t used = strlen(line);
        snprintf(line + used, sizeof line - used, " %s", text);
    }
    tui_post(t, "%s", line);
}

/* By name. */
static void send_each(struct tui *t, bool gains)
{
    char text[40];
    const struct mk_ctrl_ops *ops = t->gains.setup;
    for (int i = 0; i < ops->param_count; i++) {
        if (ops->param[i].gain != gains || !t->gains.pending[i])
            continue;
        number(text, sizeof text, t->gains.value[i]);
        tui_post(t, "set %s %s", ops->param[i].name, text);
    }
}

static void send(struct tui *t)
{
    struct tui_gains *g = &t->gains;
    struct poles p;
    double value[MK_CTRL_MAX_PARAMS];
    take_edit(t);
    if (!anything_pending(g))
        return;
    all_values(t, value);
    poles_of_setup(g->setup, &t->status.nominal, 1.0 / t->status.config.rate_hz, value, &p);
    if (p.n && !p.stable && !g->sure) {
        snprintf(g->note, sizeof g->note, "UNSTABLE with these gains: d once more sends them");
        g->sure = true;
        return;
    }
    if (pending_gains(g) > 1)
        send_gains(t);
    else
        send_each(t, true);
    send_each(t, false);
    memset(g->pending, 0, sizeof g->pending);
    g->sure = false;
    snprintf(g->note, sizeof g->note, "sent");
}

/* --- keys ------------------------------------------------------------------------------------ */

static bool typed(struct tui_gains *g, int key)
{
    size_t n = strlen(g->edit);
    if (key == TK_ERASE && n > 0) {
        g->edit[n - 1] = '\0';
        return true;
    }
    bool digit = (key >= '0' && key <= '9') || key == '.';
    bool sign = key == '-' || (n > 0 && (key == '+' || key == 'e'));
    if ((!digit && !sign) || n + 1 >= sizeof g->edit)
        return false;
    g->edit[n] = (char)key;
    g->edit[n + 1] = '\0';
    g->note[0] = '\0';
    return true;
}

/* A twentieth of the value, or of its first value where it is 0. */
static double step_of(const struct tui *t, int row)
{
    double x = fabs(value_of(t, row));
    if (x < 1e-12)
        x = fabs(t->status.initial[row]);
    return x > 1e-12 ? 0.05 * x : 0.05;
}

/* Keys that go to another parameter: how many down; 0 for any other key. */
static int rows_down(int key)
{
    switch (key) {
    case TK_UP:
    case 'k':
        return -1;
    case TK_DOWN:
    case TK_TAB:
    case 'j':
        return 1;
    default:
        return 0;
    }
}

static void escape(struct tui *t)
{
    if (t->gains.edit[0])
        t->gains.edit[0] = '\0';
    else
        t->mode = MODE_MAIN;
}

/* Keys that change the chosen parameter, or do something with all of them. */
static void act(struct tui *t, int key)
{
    struct tui_gains *g = &t->gains;
    switch (key) {
    case TK_RIGHT:
    case '+':
        put(t, g->row, value_of(t, g->row) + step_of(t, g->row));
        break;
    case TK_LEFT:
        put(t, g->row, value_of(t, g->row) - step_of(t, g->row));
        break;
    case 'o':
        put(t, g->row, t->status.initial[g->row]);
        break;
    case 'u':
        memset(g->pending, 0, sizeof g->pending);
        break;
    case 'd':
        send(t);
        break;
    case 'r':
        if (g->setup->takes_signal)
            tui_open_prompt(t, ":", g->setup->output ? "ref " : "input ");
        break;
    case TK_ESCAPE:
        escape(t);
        break;
    case 'q':
    case 'g':
        t->mode = MODE_MAIN;
        break;
    default:
        break;
    }
}

void gains_key(struct tui *t, int key)
{
    struct tui_gains *g = &t->gains;
    if (g->setup != t->status.setup || !g->setup) {
        t->mode = MODE_MAIN;
        return;
    }
    if (typed(g, key))
        return;
    if (key == TK_UP || key == TK_DOWN || key == TK_RETURN || key == TK_TAB)
        take_edit(t);
    const int n = g->setup->param_count, down = rows_down(key);
    if (down)
        g->row = (g->row + n + down) % n;
    else
        act(t, key);
}

/* --- drawing --------------------------------------------------------------------------------- */

/* Columns of the form; the scope has the others. */
#define FORM_COLS 40
#define WIDE_FORM_COLS 60
#define SCOPE_LEAST_COLS 24
#define LIST_LEAST_ROWS 3

static const char keys[] =
    "type a number  Left Right 5 %  d send  o as at first  u undo  Esc leave";
static const char signal_keys[] = "  r reference";

int gains_columns(int cols)
{
    int room = cols - SCOPE_LEAST_COLS;
    int wish = cols >= 110 ? WIDE_FORM_COLS : FORM_COLS;
    return wish < room ? wish : room;
}

static void draw_row(const struct tui *t, struct canvas *c, struct tui_rect r, int i, int row)
{
    const struct tui_gains *g = &t->gains;
    const struct mk_ctrl_param *p = &g->setup->param[i];
    bool chosen = i == g->row, wide = r.cols >= WIDE_FORM_COLS - 2;
    enum tui_style style = chosen ? STYLE_SELECTED : STYLE_NORMAL;
    canvas_fill(c, (struct tui_rect){row, r.col, 1, r.cols}, ' ', style);
    char next[40] = "";
    if (chosen && g->edit[0])
        snprintf(next, sizeof next, "%.12s_", g->edit);
    else if (g->pending[i])
        snprintf(next, sizeof next, "%.6g", g->value[i]);
    int col =
        canvas_print(c, row, r.col, r.cols, style, "%c%-13.13s", p->gain ? '*' : ' ', p->name);
    if (wide)
        col = canvas_print(c, row, col, r.cols, style, " %-8.8s",
                           mk_model_unit(&t->status.model, -1, p->unit));
    col = canvas_print(c, row, col, r.col + r.cols - col, style, "%10.6g", t->status.value[i]);
    col = canvas_print(c, row, col, r.col + r.cols - col, chosen || !next[0] ? style : STYLE_WARN,
                       " %c%10s", next[0] ? '>' : ' ', next);
    if (wide)
        canvas_print(c, row, col, r.col + r.cols - col, style, " %10.6g", t->status.initial[i]);
}

/* What a parameter is, whole. */
static void describe(const struct tui *t, int i, char *text, size_t size)
{
    const struct mk_ctrl_param *p = &t->gains.setup->param[i];
    const char *unit = mk_model_unit(&t->status.model, -1, p->unit);
    snprintf(text, size, "%s; %.5g .. %.5g%s%s, at first %.6g", p->help, p->min, p->max,
             unit[0] ? " " : "", unit, t->status.initial[i]);
}

static int lines_of(struct canvas *c, int cols, const char *text)
{
    int need = canvas_wrap(c, (struct tui_rect){0, 0, 0, cols}, STYLE_NORMAL, text);
    return need > 0 ? need : 1;
}

/* Lines of the longest description, so that the list stands still. */
static int most_lines(const struct tui *t, struct canvas *c, int cols)
{
    char text[300];
    int most = 1;
    for (int i = 0; i < t->gains.setup->param_count; i++) {
        describe(t, i, text, sizeof text);
        int need = lines_of(c, cols, text);
        most = need > most ? need : most;
    }
    return most;
}

/* The poles that the values in force and to be sent give, in words. */
static enum tui_style tell_poles(const struct tui *t, char *text, size_t size)
{
    double value[MK_CTRL_MAX_PARAMS];
    struct poles p;
    all_values(t, value);
    poles_of_setup(t->gains.setup, &t->status.nominal, 1.0 / t->status.config.rate_hz, value, &p);
    if (p.n == 0) {
        snprintf(text, size, "poles: not known for this setup");
        return STYLE_DIM;
    }
    size_t used = (size_t)snprintf(text, size,
                                   "%s at %s; poles, 1/s:", p.stable ? "stable" : "UNSTABLE", p.at);
    for (int i = 0; i < p.n && used < size; i++) {
        if (p.im[i] > 0.0)
            used +=
                (size_t)snprintf(text + used, size - used, " %.2f\u00b1%.2fi", p.re[i], p.im[i]);
        else if (p.im[i] == 0.0)
            used += (size_t)snprintf(text + used, size - used, " %.2f", p.re[i]);
    }
    return p.stable ? STYLE_GOOD : STYLE_BAD;
}

/* Text in the last rows of what is left of `in`, which it is taken from. */
static void draw_below(struct canvas *c, struct tui_rect *in, int rows, enum tui_style style,
                       const char *text)
{
    in->rows -= rows;
    canvas_wrap(c, (struct tui_rect){in->row + in->rows, in->col, rows, in->cols}, style, text);
}

/* The list, with marks where it goes on. */
static void draw_list(struct tui *t, struct canvas *c, struct tui_rect in)
{
    struct tui_gains *g = &t->gains;
    int rows = in.rows - 1, n = g->setup->param_count;
    if (g->row < g->top)
        g->top = g->row;
    if (g->row >= g->top + rows)
        g->top = g->row - rows + 1;
    bool wide = in.cols >= WIDE_FORM_COLS - 2;
    canvas_print(c, in.row, in.col, in.cols, STYLE_TITLE, "%-14s%s%10s %11s%s", "* is a gain",
                 wide ? " unit    " : "", "in force", "to send", wide ? "   at first" : "");
    for (int i = 0; i < rows && g->top + i < n; i++)
        draw_row(t, c, in, g->top + i, in.row + 1 + i);
    int last = in.col + in.cols - 1;
    if (g->top > 0)
        canvas_put(c, in.row + 1, last, '^', STYLE_KEY);
    if (g->top + rows < n)
        canvas_put(c, in.row + rows, last, 'v', STYLE_KEY);
}

void gains_draw(struct tui *t, struct tui_rect area)
{
    struct tui_gains *g = &t->gains;
    struct canvas *c = &t->canvas;
    canvas_fill(c, area, ' ', STYLE_NORMAL);
    if (!g->setup || g->setup != t->status.setup) {
        t->mode = MODE_MAIN;
        return;
    }
    char text[600], title[100];
    snprintf(title, sizeof title, "gains of %s%s", g->setup->name,
             t->status.running ? ", RUNNING" : "");
    struct tui_rect in = canvas_frame(c, area, title);
    snprintf(text, sizeof text, "%s%s", keys, g->setup->takes_signal ? signal_keys : "");
    draw_below(c, &in, lines_of(c, in.cols, text), STYLE_KEY, text);
    draw_below(c, &in, lines_of(c, in.cols, g->note), STYLE_WARN, g->note);
    enum tui_style style = tell_poles(t, text, sizeof text);
    int rows = lines_of(c, in.cols, text), least = LIST_LEAST_ROWS + 1;
    draw_below(c, &in, rows < in.rows - least ? rows : 1, style, text);
    describe(t, g->row, text, sizeof text);
    rows = most_lines(t, c, in.cols);
    if (in.rows > least)
        draw_below(c, &in, rows < in.rows - least ? rows : in.rows - least, STYLE_DIM, text);
    draw_list(t, c, in);
}

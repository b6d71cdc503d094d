#include "console/tui_gains.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "console/tui.h"
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
    poles_of_setup(g->setup, &t->status.believed, 1.0 / t->status.config.rate_hz, value, &p);
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

void gains_key(struct tui *t, int key)
{
    struct tui_gains *g = &t->gains;
    if (g->setup != t->status.setup || !g->setup) {
        t->mode = MODE_MAIN;
        return;
    }
    int n = g->setup->param_count;
    if (typed(g, key))
        return;
    bool moves = key == TK_UP || key == TK_DOWN || key == TK_RETURN || key == TK_TAB;
    if (moves)
        take_edit(t);
    if (key == TK_UP || key == 'k')
        g->row = (g->row + n - 1) % n;
    else if (key == TK_DOWN || key == TK_TAB || key == 'j')
        g->row = (g->row + 1) % n;
    else if (key == TK_RIGHT || key == '+')
        put(t, g->row, value_of(t, g->row) + step_of(t, g->row));
    else if (key == TK_LEFT)
        put(t, g->row, value_of(t, g->row) - step_of(t, g->row));
    else if (key == 'o')
        put(t, g->row, t->status.initial[g->row]);
    else if (key == 'u')
        memset(g->pending, 0, sizeof g->pending);
    else if (key == 'd')
        send(t);
    else if (key == TK_ESCAPE && g->edit[0])
        g->edit[0] = '\0';
    else if (key == TK_ESCAPE || key == 'q' || key == 'g')
        t->mode = MODE_MAIN;
}

/* --- drawing --------------------------------------------------------------------------------- */

static void draw_row(const struct tui *t, struct canvas *c, struct tui_rect r, int i, int row)
{
    const struct tui_gains *g = &t->gains;
    const struct mk_ctrl_param *p = &g->setup->param[i];
    bool chosen = i == g->row;
    enum tui_style style = chosen ? STYLE_SELECTED : STYLE_NORMAL;
    canvas_fill(c, (struct tui_rect){row, r.col, 1, r.cols}, ' ', style);
    char next[40] = "", range[40];
    if (chosen && g->edit[0])
        snprintf(next, sizeof next, "%.12s_", g->edit);
    else if (g->pending[i])
        snprintf(next, sizeof next, "%.6g", g->value[i]);
    snprintf(range, sizeof range, "%.5g .. %.5g", p->min, p->max);
    canvas_print(c, row, r.col + 1, r.cols - 1, style, "%c%-14s%-8s%10.6g", p->gain ? '*' : ' ',
                 p->name, mk_model_unit(&t->status.model, -1, p->unit), t->status.value[i]);
    canvas_print(c, row, r.col + 35, r.cols - 35, chosen || !next[0] ? style : STYLE_WARN, "%s%10s",
                 next[0] ? ">" : " ", next);
    canvas_print(c, row, r.col + 47, r.cols - 47, style, "%10.6g  %s", t->status.initial[i], range);
    if (r.cols > 110)
        canvas_text(c, row, r.col + 82, r.cols - 82, style, p->help);
}

static void draw_poles(const struct tui *t, struct canvas *c, int row, struct tui_rect r)
{
    double value[MK_CTRL_MAX_PARAMS];
    struct poles p;
    all_values(t, value);
    poles_of_setup(t->gains.setup, &t->status.believed, 1.0 / t->status.config.rate_hz, value, &p);
    if (p.n == 0) {
        canvas_text(c, row, r.col + 1, r.cols - 1, STYLE_DIM, "poles: not known for this setup");
        return;
    }
    int col = canvas_print(c, row, r.col + 1, r.cols - 1, p.stable ? STYLE_GOOD : STYLE_BAD,
                           "%s at %s", p.stable ? "stable" : "UNSTABLE", p.at);
    col = canvas_text(c, row, col, r.cols, STYLE_DIM, "  poles, 1/s: ");
    for (int i = 0; i < p.n; i++) {
        if (p.im[i] < 0.0)
            continue;
        char text[48];
        if (p.im[i] > 0.0)
            snprintf(text, sizeof text, "%.2f\u00b1%.2fi  ", p.re[i], p.im[i]);
        else
            snprintf(text, sizeof text, "%.2f  ", p.re[i]);
        col = canvas_text(c, row, col, r.col + r.cols - col,
                          p.re[i] < 0.0 ? STYLE_NORMAL : STYLE_BAD, text);
    }
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
    char title[100];
    snprintf(title, sizeof title, "gains and parameters of %s%s", g->setup->name,
             t->status.running ? ", RUNNING" : "");
    struct tui_rect in = canvas_frame(c, area, title);
    int rows = in.rows - 5, n = g->setup->param_count;
    if (g->row < g->top)
        g->top = g->row;
    if (g->row >= g->top + rows)
        g->top = g->row - rows + 1;
    canvas_print(c, in.row, in.col + 1, in.cols - 1, STYLE_TITLE, " %-14s%-8s%10s %10s %11s  %s",
                 "* is a gain", "unit", "in force", "to send", "at first", "range");
    for (int i = 0; i < rows && g->top + i < n; i++)
        draw_row(t, c, in, g->top + i, in.row + 1 + i);
    int row = in.row + in.rows - 4;
    canvas_text(c, row, in.col + 1, in.cols - 1, STYLE_DIM, g->setup->param[g->row].help);
    draw_poles(t, c, row + 1, in);
    canvas_text(c, row + 2, in.col + 1, in.cols - 1, STYLE_WARN, g->note);
    canvas_text(c, row + 3, in.col + 1, in.cols - 1, STYLE_KEY,
                "type a number   Left Right 5 %   d send   o as at first   u undo   Esc leave");
}

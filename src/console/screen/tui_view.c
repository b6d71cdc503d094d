/* Layout of the screen: title, panels, scope, events, keys. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "console/screen/tui.h"
#include "console/screen/tui_rig.h"

#define DEGREES (180.0 / 3.14159265358979324)
#define PANEL_COLS 27
#define WIDE_PANEL_COLS 38

/* --- title ----------------------------------------------------------------------------------- */

struct title {
    const char *state;
    enum tui_style style;
    char more[120];
};

static void name_state(const struct tui *t, struct title *out)
{
    const struct host_status *st = &t->status;
    const struct mk_loop_snapshot *snap = &st->snap;
    *out = (struct title){"NO SETUP", STYLE_BAR, ""};
    /* What the motor does comes before what is looked at. */
    if (st->have_loop && snap->state == MK_LOOP_FAULTED) {
        out->state = "FAULT";
        out->style = STYLE_BAD;
        char joint[24] = "";
        if (snap->fault_joint > 0)
            snprintf(joint, sizeof joint, " joint %d", snap->fault_joint);
        snprintf(out->more, sizeof out->more, "%s%s at %.2f s, motor off",
                 mk_fault_name(snap->fault), joint, snap->fault_t);
    } else if (st->running) {
        out->state = "RUNNING";
        out->style = STYLE_GOOD;
        snprintf(out->more, sizeof out->more, "%s  t %.2f s", mk_phase_name(snap->sample.phase),
                 snap->sample.t);
    } else if (t->in_log) {
        out->state = t->playing ? "REPLAY" : "LOG";
        snprintf(out->more, sizeof out->more, "t %.2f s", t->log.end_t);
    } else if (st->setup) {
        out->state = "READY";
        snprintf(out->more, sizeof out->more, "motor off%s",
                 !st->looked || st->fast ? ""
                 : st->still             ? ", links still"
                                         : ", links move");
    }
}

static void draw_title(const struct tui *t, struct canvas *c)
{
    struct title name;
    char text[200];
    name_state(t, &name);
    canvas_fill(c, (struct tui_rect){0, 0, 1, c->cols}, ' ', STYLE_BAR);
    const struct host_status *st = &t->status;
    snprintf(text, sizeof text, " mechkit   %s   %s%s", st->setup ? st->setup->name : "-",
             st->backend ? st->backend->name : "-",
             st->fast                         ? " (simulated time)"
             : st->setup && st->config.stream ? " (board's clock)"
                                              : "");
    canvas_text(c, 0, 0, c->cols, STYLE_BAR, text);
    snprintf(text, sizeof text, " %s %s%s", name.state, name.more[0] ? " " : "", name.more);
    int width = tui_columns(text) + 1, at = c->cols - width;
    if (at < 12)
        at = 12;
    canvas_fill(c, (struct tui_rect){0, at, 1, c->cols - at}, ' ', name.style);
    canvas_text(c, 0, at, c->cols - at, name.style, text);
}

/* --- figures --------------------------------------------------------------------------------- */

struct figures { /* of the instant that is shown */
    bool known;
    double q[MK_MAX_JOINTS], v[MK_MAX_JOINTS], u, ref;
    enum mk_plant_kind plant;
    int joints;
    bool slides[MK_MAX_JOINTS];
};

static void from_point(const struct scope *s, double t, struct figures *f)
{
    const struct scope_point *p = scope_find(s, t);
    if (!p)
        return;
    f->known = true;
    f->q[0] = (double)p->y[CH_Q1];
    f->q[1] = (double)p->y[CH_Q2];
    f->v[0] = (double)p->y[CH_V1];
    f->v[1] = (double)p->y[CH_V2];
    f->u = (double)p->y[CH_U];
    f->ref = (double)p->y[CH_REF];
}

static struct figures figures_now(const struct tui *t)
{
    const struct scope *s = t->in_log ? &t->log : &t->live;
    struct figures f = {.plant = t->in_log ? t->log_plant : t->status.model.plant,
                        .ref = (double)NAN};
    f.joints = mk_plant(f.plant)->joints;
    memcpy(f.slides, t->in_log ? t->log_slides : t->status.model.joint_linear, sizeof f.slides);
    if (s->cursor_on)
        from_point(s, s->cursor_t, &f);
    else if (t->in_log)
        from_point(s, s->end_t, &f);
    else if (t->status.running && t->have_newest)
        from_point(s, scope_last_t(s), &f);
    else if (t->status.looked) {
        f.known = true;
        memcpy(f.q, t->status.q, sizeof f.q);
        f.v[0] = f.v[1] = (double)NAN;
    }
    return f;
}

static void draw_angle(struct canvas *c, int row, struct tui_rect r, int joint,
                       const struct figures *f)
{
    enum tui_style style = joint ? STYLE_TRACE_B : STYLE_TRACE_A;
    canvas_print(c, row, r.col + 1, 4, style, "q%d", joint + 1);
    if (!f->known || !isfinite(f->q[joint])) {
        canvas_text(c, row, r.col + 5, r.cols - 5, STYLE_DIM, "       -");
        return;
    }
    int col = canvas_print(c, row, r.col + 5, 9, STYLE_VALUE, "%9.4f", f->q[joint]);
    col = canvas_text(c, row, col, 4, STYLE_DIM, f->slides[joint] ? " m" : " rad");
    if (f->slides[joint] || mk_plant(f->plant)->joint_is_wheel[joint])
        return; /* turns and turns */
    double degrees = f->q[joint] * DEGREES;
    canvas_print(c, row, col, r.cols - (col - r.col), STYLE_DIM, "%6.*f\u00b0",
                 degrees > -99.95 && degrees < 999.95 ? 1 : 0, degrees);
}

static void draw_speed(struct canvas *c, int row, struct tui_rect r, int joint,
                       const struct figures *f)
{
    canvas_print(c, row, r.col + 1, 4, joint ? STYLE_TRACE_B : STYLE_TRACE_A, "dq%d", joint + 1);
    if (!f->known || !isfinite(f->v[joint])) {
        canvas_text(c, row, r.col + 5, r.cols - 5, STYLE_DIM, "       -");
        return;
    }
    int col = canvas_print(c, row, r.col + 5, 9, STYLE_VALUE, "%9.3f", f->v[joint]);
    canvas_text(c, row, col, 6, STYLE_DIM, f->slides[joint] ? " m/s" : " rad/s");
}

/* The command from its middle; at the limit it says so. */
static void draw_command(struct canvas *c, int row, struct tui_rect r, const struct figures *f,
                         double limit)
{
    canvas_text(c, row, r.col + 1, 4, STYLE_TRACE_C, "u");
    bool full = f->known && fabs(f->u) >= limit * 0.9999;
    int width = r.cols - 2, from = r.col + 1, middle = width / 2;
    if (f->known) {
        int col = canvas_print(c, row, r.col + 5, 9, STYLE_VALUE, "%9.3f", f->u);
        if (full)
            canvas_text(c, row, col + 1, r.cols - 15, STYLE_WARN, "AT LIMIT");
        else
            canvas_print(c, row, col, r.cols - 14, STYLE_DIM, " of %.3g", limit);
    } else {
        canvas_text(c, row, r.col + 5, r.cols - 5, STYLE_DIM, "       -");
    }
    for (int k = 0; k < width; k++)
        canvas_put(c, row + 1, from + k, 0xb7, STYLE_DIM);
    int length = f->known ? (int)lround(fmin(1.0, fabs(f->u) / limit) * (width - 1 - middle)) : 0;
    for (int k = 1; k <= length; k++)
        canvas_put(c, row + 1, from + middle + (f->u > 0.0 ? k : -k), 0x2588,
                   full ? STYLE_WARN : STYLE_TRACE_C);
    canvas_put(c, row + 1, from + middle, 0x2502, STYLE_NORMAL);
}

/* Where rows are scarce the speeds share one. */
static void draw_speeds(struct canvas *c, int row, struct tui_rect r, const struct figures *f)
{
    canvas_text(c, row, r.col + 1, 4, STYLE_TITLE, "dq");
    if (f->known && isfinite(f->v[0]) && isfinite(f->v[1])) {
        canvas_print(c, row, r.col + 4, 8, STYLE_VALUE, "%7.2f", f->v[0]);
        canvas_print(c, row, r.col + 11, 8, STYLE_VALUE, "%8.2f", f->v[1]);
        canvas_text(c, row, r.col + 19, r.cols - 19, STYLE_DIM, f->slides[0] ? "" : " rad/s");
    } else {
        canvas_text(c, row, r.col + 5, r.cols - 5, STYLE_DIM, "       -");
    }
}

static int draw_figures(const struct tui *t, struct canvas *c, struct tui_rect r, bool compact)
{
    struct figures f = figures_now(t);
    int row = r.row;
    for (int j = 0; j < f.joints; j++)
        draw_angle(c, row++, r, j, &f);
    if (compact && f.joints > 1)
        draw_speeds(c, row++, r, &f);
    else
        for (int j = 0; j < f.joints; j++)
            draw_speed(c, row++, r, j, &f);
    draw_command(c, row, r, &f, t->status.setup ? t->status.model.u_max : 10.0);
    return row + 2;
}

static int draw_loop(const struct tui *t, struct canvas *c, struct tui_rect r)
{
    const struct host_status *st = &t->status;
    const struct mk_loop_stats *s = &st->stats;
    if (!st->setup) {
        canvas_text(c, r.row, r.col + 1, r.cols - 1, STYLE_DIM, "-");
        return r.row + 1;
    }
    bool ran = st->have_loop && s->ticks > 0;
    canvas_print(c, r.row, r.col + 1, r.cols - 1, STYLE_NORMAL, "%.0f Hz  %s", st->config.rate_hz,
                 st->fast      ? "simulated time"
                 : !ran        ? ""
                 : s->realtime ? "real time"
                               : "NOT real time");
    if (!ran)
        return r.row + 1;
    canvas_print(c, r.row + 1, r.col + 1, r.cols - 1, STYLE_NORMAL, "late us p99 %.0f max %.0f",
                 s->late_p99_us, s->late_max_us);
    bool trouble = s->overruns || s->lost || s->dropped;
    canvas_print(c, r.row + 2, r.col + 1, r.cols - 1, trouble ? STYLE_WARN : STYLE_NORMAL,
                 "overruns %llu  lost %llu", (unsigned long long)s->overruns,
                 (unsigned long long)s->lost);
    return r.row + 3;
}

/* --- the left column ------------------------------------------------------------------------- */

static void draw_panel(const struct tui *t, struct canvas *c, struct tui_rect r)
{
    struct tui_rect in = canvas_frame(c, r, "angles and command");
    int row = draw_figures(t, c, in, r.rows < 24);
    canvas_rule(c, r, row, "loop");
    in.row = row + 1;
    row = draw_loop(t, c, in);
    int left = r.row + r.rows - 1 - row;
    if (left < 4)
        return;
    struct figures f = figures_now(t);
    bool drawn = t->in_log || t->status.setup;
    canvas_rule(c, r, row, drawn ? mk_plant(f.plant)->name : "rig");
    if (f.known)
        rig_draw(c, (struct tui_rect){row + 1, in.col, left - 1, in.cols}, f.plant, f.q);
}

/* --- scope, card, events --------------------------------------------------------------------- */

static void draw_scope(struct tui *t, struct canvas *c, struct tui_rect r)
{
    struct scope *s = tui_scope_in_view(t);
    char caption[120], title[200];
    struct tui_rect in = canvas_frame(c, r, NULL);
    if (s->count) {
        scope_draw(s, c, in);
        scope_caption(s, caption, sizeof caption);
        snprintf(title, sizeof title, " %.40s %s%s ", t->in_log ? t->log_name : "scope", caption,
                 s->has_model ? "  dotted: model" : "");
    } else {
        tui_draw_check(t, in);
        snprintf(title, sizeof title, " before the start ");
    }
    canvas_text(c, r.row, r.col + 2, r.cols - 4, STYLE_TITLE, title);
}

/* Lines of a card as they are broken to its width; only those from `top` on, `rows` of them, are
 * drawn. Returns how many there are. */
static int draw_card_lines(struct tui_card *card, struct canvas *c, struct tui_rect in, int rows)
{
    int line = 0;
    for (int i = 0; i < card->count; i++) {
        const char *text = card->line[i];
        enum tui_style style = strncmp(text, "FAULT", 5) == 0 ? STYLE_BAD : STYLE_NORMAL;
        int at = line - card->top;
        struct tui_rect r = {in.row + at, in.col + 1, rows - at, in.cols - 2};
        struct tui_rect none = {0, 0, 0, in.cols - 2};
        int need = canvas_wrap(c, at >= 0 && at < rows ? r : none, style, text);
        line += need > 0 ? need : 1;
    }
    return line;
}

static void draw_card(struct tui *t, struct canvas *c, struct tui_rect area)
{
    struct tui_card *card = &t->card;
    struct tui_rect in = {0, 0, 0, area.cols - 2};
    int lines = draw_card_lines(card, c, in, 0);
    int rows = lines + 2 < area.rows ? lines + 2 : area.rows;
    struct tui_rect r = {area.row + area.rows - rows, area.col, rows, area.cols};
    canvas_fill(c, r, ' ', STYLE_NORMAL);
    in = canvas_frame(c, r, card->title);
    int most = lines > in.rows ? lines - in.rows : 0;
    if (card->top > most)
        card->top = most;
    draw_card_lines(card, c, in, in.rows);
    if (most > 0)
        canvas_print(c, r.row + r.rows - 1, r.col + r.cols - 24, 23, STYLE_DIM,
                     " %d-%d of %d, Up Down ", card->top + 1, card->top + in.rows, lines);
}

/* The line of an event, broken where it must be; returns the rows it takes. */
static int draw_event(struct canvas *c, struct tui_rect r, const struct host_event *e)
{
    static const enum tui_style styles[] = {STYLE_NORMAL, STYLE_DIM, STYLE_BAD, STYLE_WARN};
    static const char *const marks[] = {"", ": ", "ERROR ", "NOTE "};
    char text[HOST_TEXT + 40], clock[16];
    struct tm parts;
    snprintf(text, sizeof text, "%s%s", marks[e->kind], e->text);
    int need = canvas_wrap(c, r, styles[e->kind], text);
    if (r.rows > 0) {
        localtime_r(&e->when, &parts);
        strftime(clock, sizeof clock, "%H:%M:%S", &parts);
        canvas_text(c, r.row, 1, 8, STYLE_DIM, clock);
    }
    return need > 0 ? need : 1;
}

/* The newest at the bottom, as many as there is room for. */
static void draw_events(const struct tui *t, struct canvas *c, int row, int rows)
{
    int bottom = row + rows;
    for (int i = t->events - 1; i >= 0 && bottom > row; i--) {
        struct tui_rect none = {0, 10, 0, c->cols - 11};
        int need = draw_event(c, none, &t->event[i]);
        int from = bottom - need;
        if (from < row && i < t->events - 1)
            return;
        from = from < row ? row : from;
        draw_event(c, (struct tui_rect){from, 10, bottom - from, c->cols - 11}, &t->event[i]);
        bottom = from;
    }
}

/* What goes on besides the run: a command that waits, a calculation, a recording. */
static void draw_doing(const struct tui *t, struct canvas *c, int row)
{
    const struct host_status *st = &t->status;
    char text[200] = "";
    if (st->progress >= 0.0)
        snprintf(text, sizeof text, " %.40s: %.0f %% %.40s   h ends it ", st->doing,
                 100.0 * st->progress, st->progress_what);
    else if (st->doing[0])
        snprintf(text, sizeof text, " %.60s ... ", st->doing);
    else if (st->record_path[0])
        snprintf(text, sizeof text, " recording to %.60s, R ends it ", st->record_path);
    int width = tui_columns(text);
    canvas_text(c, row, c->cols - width - 2, width, STYLE_SELECTED, text);
}

/* --- all ------------------------------------------------------------------------------------- */

static void draw_too_small(struct canvas *c)
{
    canvas_print(c, 0, 0, c->cols, STYLE_WARN, "too small: %d x %d at least", TUI_MIN_COLS,
                 TUI_MIN_ROWS);
    canvas_text(c, 1, 0, c->cols, STYLE_BAD, "Space: E-STOP");
}

void tui_draw(struct tui *t, int rows, int cols)
{
    struct canvas *c = &t->canvas;
    if ((c->rows != rows || c->cols != cols) && canvas_resize(c, rows, cols) != MK_OK)
        return;
    canvas_clear(c);
    if (rows < TUI_MIN_ROWS || cols < TUI_MIN_COLS) {
        draw_too_small(c);
        return;
    }
    int events = rows >= 40 ? 6 : rows >= 22 ? 3 : 1;
    /* As wide as the rig's picture can make use of. */
    int panel = cols >= 160 ? cols * 3 / 10 : cols >= 110 ? WIDE_PANEL_COLS : PANEL_COLS;
    bool form = t->mode == MODE_GAINS;
    panel = form ? gains_columns(cols) : panel;
    struct tui_rect body = {1, 0, rows - 2 - events, cols};
    struct tui_rect scope = {1, panel, body.rows, cols - panel};
    draw_title(t, c);
    if (!form)
        draw_panel(t, c, (struct tui_rect){1, 0, body.rows, panel});
    draw_scope(t, c, scope);
    draw_events(t, c, rows - 1 - events, events);
    draw_doing(t, c, rows - 2 - events);
    if (t->card.shown && t->mode == MODE_MAIN)
        draw_card(t, c, (struct tui_rect){scope.row + 1, scope.col, scope.rows - 2, scope.cols});
    if (t->mode == MODE_MAIN)
        tui_draw_keys(t, c, rows - 1);
    else
        tui_draw_mode(t, body);
}

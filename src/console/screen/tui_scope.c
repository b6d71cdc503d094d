#include "console/screen/tui_scope.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const channels[CH_COUNT] = {"q1", "q2", "dq1", "dq2", "u", "ref"};

#define TURN (2.0 * 3.14159265358979323846)

static const double windows[] = {0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0};
#define WINDOWS ((int)(sizeof windows / sizeof windows[0]))

const char *scope_channel_name(enum scope_channel ch)
{
    return channels[ch];
}

bool scope_has(const struct scope *s, enum scope_channel ch)
{
    if (ch == CH_Q2 || ch == CH_V2)
        return s->joints > 1;
    return ch != CH_REF || s->has_ref;
}

static bool is_shown(const struct scope *s, int ch)
{
    return (s->shown & 1u << ch) && scope_has(s, (enum scope_channel)ch);
}

void scope_select(struct scope *s, int step)
{
    for (int k = 1; k <= CH_COUNT; k++) {
        int ch = (s->selected + k * step + CH_COUNT * CH_COUNT) % CH_COUNT;
        if (is_shown(s, ch)) {
            s->selected = (enum scope_channel)ch;
            return;
        }
    }
}

/* --- samples --------------------------------------------------------------------------------- */

enum mk_status scope_init(struct scope *s, size_t room)
{
    memset(s, 0, sizeof *s);
    s->point = calloc(room, sizeof *s->point);
    if (!s->point)
        return MK_ERR_NOMEM;
    s->room = room;
    s->joints = 2;
    s->shown = 1u << CH_Q1 | 1u << CH_Q2 | 1u << CH_U;
    s->window_s = 5.0;
    return MK_OK;
}

void scope_free(struct scope *s)
{
    free(s->point);
    s->point = NULL;
    s->room = s->count = 0;
}

void scope_clear(struct scope *s, const struct mk_plant_info *plant)
{
    s->first = s->count = 0;
    s->has_ref = s->has_model = s->frozen = s->cursor_on = false;
    memset(s->turns, 0, sizeof s->turns);
    if (!plant || plant == s->plant)
        return;
    s->plant = plant;
    s->joints = plant->joints;
    s->shown = 1u << CH_U;
    /* The angle of a wheel says nothing; its speed does. */
    for (int j = 0; j < plant->joints; j++)
        s->shown |= 1u << (plant->joint_is_wheel[j] ? CH_V1 + j : CH_Q1 + j);
    memset(s->half_range, 0, sizeof s->half_range);
    s->selected = CH_REF;
    scope_select(s, 1); /* the first that is shown */
}

static struct scope_point *next_point(struct scope *s)
{
    if (s->count < s->room)
        return &s->point[(s->first + s->count++) % s->room];
    struct scope_point *p = &s->point[s->first];
    s->first = (s->first + 1) % s->room;
    return p;
}

static void scope_forget(struct scope *s)
{
    s->first = s->count = 0;
    memset(s->turns, 0, sizeof s->turns);
}

/* Whether a joint hangs or stands: its equilibria differ. */
static bool swings(const struct mk_plant_info *plant, int joint)
{
    for (int i = 1; i < plant->equilibrium_count; i++)
        if (plant->equilibrium[i].q[joint] != plant->equilibrium[0].q[joint])
            return true;
    return false;
}

/* How far the angles of a point are from an equilibrium, whole turns left out. */
static double away_from(const struct scope *s, const struct scope_point *p,
                        const struct mk_equilibrium *e)
{
    double most = 0.0;
    for (int j = 0; j < s->plant->joints; j++)
        if (swings(s->plant, j))
            most = fmax(most, fabs(remainder((double)p->y[CH_Q1 + j] - e->q[j], TURN)));
    return most;
}

/* The equilibrium that a balanced point is at. */
static const struct mk_equilibrium *nearest(const struct scope *s, const struct scope_point *p)
{
    const struct mk_equilibrium *best = NULL;
    for (int i = 0; i < s->plant->equilibrium_count; i++) {
        const struct mk_equilibrium *e = &s->plant->equilibrium[i];
        if (!best || away_from(s, p, e) < away_from(s, p, best))
            best = e;
    }
    return best;
}

/* Of a balanced point: its swinging joints are at their equilibrium, and so count from there,
 * however often they went round before. All points follow, so that traces stay whole. */
static void leave_turns_out(struct scope *s, const struct scope_point *p)
{
    const struct mk_equilibrium *e = s->plant ? nearest(s, p) : NULL;
    for (int j = 0; e && j < s->plant->joints; j++) {
        if (!swings(s->plant, j))
            continue;
        double turns = TURN * round(((double)p->y[CH_Q1 + j] - e->q[j]) / TURN);
        if (turns == 0.0)
            continue;
        s->turns[j] += turns;
        for (size_t i = 0; i < s->count; i++) {
            struct scope_point *other = &s->point[(s->first + i) % s->room];
            other->y[CH_Q1 + j] -= (float)turns;
            other->y[CH_MODEL1 + j] -= (float)turns;
        }
    }
}

void scope_add(struct scope *s, const struct mk_sample *sample)
{
    if (s->count && sample->t <= scope_last_t(s))
        scope_forget(s); /* another run */
    struct scope_point *p = next_point(s);
    p->t = sample->t;
    p->y[CH_Q1] = (float)sample->q[0];
    p->y[CH_Q2] = (float)sample->q[1];
    p->y[CH_V1] = (float)sample->v[0];
    p->y[CH_V2] = (float)sample->v[1];
    p->y[CH_U] = (float)sample->u;
    p->y[CH_REF] = (float)sample->ref;
    p->y[CH_MODEL1] = p->y[CH_MODEL2] = NAN;
    p->late_us = (float)sample->late_us;
    p->flags = (uint16_t)sample->flags;
    p->phase = (uint8_t)sample->phase;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        p->y[CH_Q1 + j] -= (float)s->turns[j];
    s->has_ref = s->has_ref || !isnan(sample->ref);
    if (p->phase == MK_PHASE_BALANCE)
        leave_turns_out(s, p);
}

static float cell(const double *column, size_t row)
{
    return column ? (float)column[row] : NAN;
}

/* A whole number below `bound`; 0 where there is none. */
static unsigned whole(const double *column, size_t row, double bound)
{
    return column && column[row] >= 0.0 && column[row] < bound ? (unsigned)column[row] : 0;
}

/* The columns of a log that the scope draws, and those of a prediction; NULL: there is none. */
static void find_channels(const struct mk_log *log, const struct mk_log *model,
                          const double *column[CH_STORED])
{
    static const char *const names[CH_COUNT] = {"q1", "q2", "dq1", "dq2", "u", "ref"};
    for (int ch = 0; ch < CH_COUNT; ch++)
        column[ch] = mk_log_get(log, names[ch]);
    column[CH_MODEL1] = model ? mk_log_get(model, "q1") : NULL;
    column[CH_MODEL2] = model ? mk_log_get(model, "q2") : NULL;
}

enum mk_status scope_load(struct scope *s, const struct mk_log *log, const struct mk_log *model)
{
    const double *column[CH_STORED], *t = mk_log_get(log, "t"), *phase = mk_log_get(log, "phase");
    const double *late = mk_log_get(log, "late_us"), *flags = mk_log_get(log, "flags");
    struct scope_point *room = calloc(log->rows, sizeof *room);
    if (!room)
        return MK_ERR_NOMEM;
    find_channels(log, model, column);
    free(s->point);
    s->point = room;
    s->room = s->count = log->rows;
    s->first = 0;
    s->has_ref = false;
    s->has_model = model != NULL;
    s->joints = column[CH_Q2] ? 2 : 1;
    for (size_t i = 0; i < log->rows; i++) {
        struct scope_point *p = &room[i];
        p->t = t[i];
        for (int ch = 0; ch < CH_STORED; ch++)
            p->y[ch] = cell(column[ch], i);
        p->phase = (uint8_t)whole(phase, i, 4.0);
        p->late_us = cell(late, i);
        p->flags = (uint16_t)whole(flags, i, 65536.0);
        s->has_ref = s->has_ref || !isnan(p->y[CH_REF]);
    }
    memset(s->turns, 0, sizeof s->turns);
    for (size_t i = log->rows; i-- > 0;)
        if (room[i].phase == MK_PHASE_BALANCE) {
            leave_turns_out(s, &room[i]);
            break;
        }
    return MK_OK;
}

const struct scope_point *scope_at(const struct scope *s, size_t index)
{
    return &s->point[(s->first + index) % s->room];
}

double scope_first_t(const struct scope *s)
{
    return s->count ? scope_at(s, 0)->t : 0.0;
}

double scope_last_t(const struct scope *s)
{
    return s->count ? scope_at(s, s->count - 1)->t : 0.0;
}

/* Number of points before or at t. */
static size_t count_until(const struct scope *s, double t)
{
    size_t low = 0, high = s->count;
    while (low < high) {
        size_t mid = low + (high - low) / 2;
        if (scope_at(s, mid)->t <= t)
            low = mid + 1;
        else
            high = mid;
    }
    return low;
}

const struct scope_point *scope_find(const struct scope *s, double t)
{
    size_t n = count_until(s, t);
    return n ? scope_at(s, n - 1) : NULL;
}

/* --- settings -------------------------------------------------------------------------------- */

void scope_zoom_time(struct scope *s, int steps)
{
    int i = 0;
    while (i < WINDOWS - 1 && windows[i] < s->window_s)
        i++;
    i += steps;
    s->window_s = windows[i < 0 ? 0 : i >= WINDOWS ? WINDOWS - 1 : i];
}

void scope_freeze(struct scope *s, bool on)
{
    if (on && !s->frozen)
        s->end_t = scope_last_t(s);
    s->frozen = on;
}

void scope_toggle(struct scope *s, enum scope_channel ch)
{
    unsigned shown = s->shown ^ 1u << ch;
    if (scope_has(s, ch) && shown)
        s->shown = shown;
    if (s->shown & 1u << ch)
        s->selected = ch;
}

void scope_next_trigger(struct scope *s)
{
    s->trigger = (enum scope_trigger)((s->trigger + 1) % TRIGGER_COUNT);
    s->level = s->centre[s->selected];
}

void scope_move_cursor(struct scope *s, int steps)
{
    double end = s->frozen ? s->end_t : scope_last_t(s);
    if (!s->cursor_on)
        s->cursor_t = end - s->window_s / 2;
    else
        s->cursor_t += steps * s->window_s / 100.0;
    s->cursor_on = true;
    if (!s->frozen)
        scope_freeze(s, true);
    s->cursor_t = fmax(scope_first_t(s), fmin(scope_last_t(s), s->cursor_t));
    /* The cursor takes the window along. */
    if (s->cursor_t > s->end_t)
        s->end_t = s->cursor_t;
    if (s->cursor_t < s->end_t - s->window_s)
        s->end_t = s->cursor_t + s->window_s;
}

void scope_pan(struct scope *s, int count)
{
    scope_freeze(s, true);
    double least = fmin(scope_first_t(s) + s->window_s, scope_last_t(s));
    s->end_t = fmax(least, fmin(scope_last_t(s), s->end_t + count * s->window_s / 2.0));
}

/* --- values and time in view ----------------------------------------------------------------- */

struct span {
    size_t from, to; /* points */
    double t0, t1;
};

static bool crosses(const struct scope *s, const struct scope_point *a, const struct scope_point *b)
{
    double x = (double)a->y[s->selected] - s->level, y = (double)b->y[s->selected] - s->level;
    switch (s->trigger) {
    case TRIGGER_RISING:
        return x < 0.0 && y >= 0.0;
    case TRIGGER_FALLING:
        return x > 0.0 && y <= 0.0;
    case TRIGGER_CATCH:
        return a->phase != MK_PHASE_BALANCE && b->phase == MK_PHASE_BALANCE;
    default:
        return false;
    }
}

/* Right edge of the newest window that the trigger fills; NAN: none yet. */
static double triggered_end(const struct scope *s)
{
    double latest = scope_last_t(s) - 0.9 * s->window_s;
    for (size_t i = count_until(s, latest); i-- > 1;)
        if (crosses(s, scope_at(s, i - 1), scope_at(s, i)))
            return scope_at(s, i)->t + 0.9 * s->window_s;
    return NAN;
}

static struct span span_in_view(struct scope *s)
{
    double end = s->frozen ? s->end_t : scope_last_t(s);
    s->waiting = false;
    if (!s->frozen && s->trigger != TRIGGER_OFF && s->count) {
        double at = triggered_end(s);
        s->waiting = isnan(at);
        end = isnan(at) ? end : at;
    }
    struct span v = {.t1 = fmax(end, scope_first_t(s) + s->window_s)};
    v.t0 = v.t1 - s->window_s;
    v.from = count_until(s, v.t0);
    v.to = count_until(s, v.t1);
    if (v.from > 0)
        v.from--; /* the line comes in from outside */
    return v;
}

static void extremes(const struct scope *s, const struct span *v, int ch, double *low, double *high)
{
    for (size_t i = v->from; i < v->to; i++) {
        double y = scope_at(s, i)->y[ch];
        if (isfinite(y)) {
            *low = fmin(*low, y);
            *high = fmax(*high, y);
        }
    }
}

/* 1, 2 or 5 times a power of ten, not below x. */
static double round_up(double x)
{
    double unit = pow(10.0, floor(log10(x)));
    double m = x / unit;
    return unit * (m <= 1.0 ? 1.0 : m <= 2.0 ? 2.0 : m <= 5.0 ? 5.0 : 10.0);
}

/* What a lane shows: as set, or what is in the window and a little more, in round numbers so that
 * the picture does not breathe. */
static void choose_range(struct scope *s, const struct span *v, int ch, double *low, double *high)
{
    if (s->half_range[ch] > 0.0) {
        *low = s->centre[ch] - s->half_range[ch];
        *high = s->centre[ch] + s->half_range[ch];
        return;
    }
    double a = INFINITY, b = -INFINITY;
    extremes(s, v, ch, &a, &b);
    if (s->has_model && ch <= CH_Q2)
        extremes(s, v, ch == CH_Q1 ? CH_MODEL1 : CH_MODEL2, &a, &b);
    if (!(a <= b))
        a = -1.0, b = 1.0;
    double least = ch == CH_U ? 0.5 : 0.02;
    double grid = round_up(fmax(b - a, least) / 10.0);
    *low = grid * floor(a / grid - 0.2) + 0.0; /* no -0 */
    *high = grid * ceil(b / grid + 0.2) + 0.0;
    s->centre[ch] = (*low + *high) / 2.0;
}

void scope_zoom_value(struct scope *s, int steps)
{
    int ch = s->selected;
    if (s->half_range[ch] <= 0.0) {
        struct span v = span_in_view(s);
        double low, high;
        choose_range(s, &v, ch, &low, &high);
        s->half_range[ch] = (high - low) / 2.0;
    }
    double wanted = s->half_range[ch] * pow(2.0, -steps);
    s->half_range[ch] = fmin(fmax(wanted, 1e-4), 1e5);
}

void scope_auto_value(struct scope *s)
{
    s->half_range[s->selected] = 0.0;
}

void scope_move_level(struct scope *s, int steps)
{
    struct span v = span_in_view(s);
    double low, high;
    choose_range(s, &v, s->selected, &low, &high);
    s->level += steps * (high - low) / 20.0;
}

void scope_caption(const struct scope *s, char *buf, size_t size)
{
    static const char *const triggers[] = {"", "rising", "falling", "catch"};
    int n = snprintf(buf, size, "%g s", s->window_s);
    if (s->trigger != TRIGGER_OFF && n > 0 && (size_t)n < size) {
        if (s->trigger == TRIGGER_CATCH)
            n += snprintf(buf + n, size - (size_t)n, "  trigger: catch");
        else
            n += snprintf(buf + n, size - (size_t)n, "  trigger: %s %s %.3g", channels[s->selected],
                          triggers[s->trigger], s->level);
    }
    if (s->waiting && n > 0 && (size_t)n < size)
        n += snprintf(buf + n, size - (size_t)n, " (waits)");
    if (s->frozen && n > 0 && (size_t)n < size)
        n += snprintf(buf + n, size - (size_t)n, "  FROZEN");
    if (s->cursor_on && n > 0 && (size_t)n < size)
        snprintf(buf + n, size - (size_t)n, "  cursor %.3f s", s->cursor_t);
}

/* --- drawing --------------------------------------------------------------------------------- */

#define LABEL_COLS 10

struct lane {
    struct scope *s;
    struct span v;
    struct dots d;
    double low, high;
};

static double dot_x(const struct lane *l, double t)
{
    return (t - l->v.t0) / (l->v.t1 - l->v.t0) * (2 * l->d.cols - 1);
}

static double dot_y(const struct lane *l, double y)
{
    double share = (l->high - y) / (l->high - l->low);
    return share * (4 * l->d.rows - 1);
}

/* Lines between the points; what lies outside runs along the edge. `gaps`: every second dot only,
 * so that it can be told apart without colours. */
static void draw_trace(struct lane *l, int ch, enum tui_style style, bool gaps)
{
    double x0 = NAN, y0 = NAN;
    double bottom = 4 * l->d.rows - 1;
    for (size_t i = l->v.from; i < l->v.to; i++) {
        const struct scope_point *p = scope_at(l->s, i);
        double x = dot_x(l, p->t), y = fmax(0.0, fmin(bottom, dot_y(l, p->y[ch])));
        if (isnan(p->y[ch]) || x < 0.0) {
            x0 = isnan(p->y[ch]) ? (double)NAN : 0.0;
            y0 = y;
            continue;
        }
        if (gaps) {
            if (((int)(x + 0.5) & 3) < 2)
                dots_set(&l->d, (int)(x + 0.5), (int)(y + 0.5), style);
        } else if (isnan(x0)) {
            dots_set(&l->d, (int)(x + 0.5), (int)(y + 0.5), style);
        } else if ((int)(x + 0.5) != (int)(x0 + 0.5) || (int)(y + 0.5) != (int)(y0 + 0.5)) {
            dots_line(&l->d, x0, y0, x, y, style);
        }
        x0 = x, y0 = y;
    }
}

static enum tui_style trace_style(int ch)
{
    static const enum tui_style style[CH_COUNT] = {STYLE_TRACE_A, STYLE_TRACE_B, STYLE_TRACE_A,
                                                   STYLE_TRACE_B, STYLE_TRACE_C, STYLE_TRACE_D};
    return style[ch];
}

/* Vertical marks: where it was caught, the cursor, the trigger's level. */
static void draw_marks(const struct lane *l, struct canvas *c, struct tui_rect r, int ch)
{
    const struct scope *s = l->s;
    for (size_t i = l->v.from + 1; i < l->v.to; i++) {
        if (scope_at(s, i)->phase != MK_PHASE_BALANCE ||
            scope_at(s, i - 1)->phase == MK_PHASE_BALANCE)
            continue;
        int col = (int)(dot_x(l, scope_at(s, i)->t) / 2.0);
        for (int k = 0; k < r.rows; k++)
            canvas_put(c, r.row + k, r.col + col, 0xb7, STYLE_GOOD);
    }
    if (s->cursor_on && s->cursor_t >= l->v.t0 && s->cursor_t <= l->v.t1) {
        int col = (int)(dot_x(l, s->cursor_t) / 2.0);
        for (int k = 0; k < r.rows; k++)
            canvas_put(c, r.row + k, r.col + col, 0x2502, STYLE_WARN);
    }
    bool leveled = s->trigger == TRIGGER_RISING || s->trigger == TRIGGER_FALLING;
    if (leveled && ch == (int)s->selected && s->level > l->low && s->level < l->high)
        canvas_put(c, r.row + (int)(dot_y(l, s->level) / 4.0), r.col, 0x25b6, STYLE_WARN);
}

static void draw_label(const struct lane *l, struct canvas *c, struct tui_rect r, int ch)
{
    const struct scope *s = l->s;
    bool selected = ch == (int)s->selected;
    const struct scope_point *p =
        scope_find(s, s->cursor_on ? s->cursor_t : fmin(l->v.t1, scope_last_t(s)));
    canvas_print(c, r.row, r.col, LABEL_COLS, selected ? STYLE_SELECTED : STYLE_TITLE, "%-3s",
                 channels[ch]);
    canvas_print(c, r.row, r.col + 3, LABEL_COLS - 3, STYLE_DIM, "%6.4g", l->high);
    if (r.rows > 2)
        canvas_print(c, r.row + r.rows - 1, r.col + 3, LABEL_COLS - 3, STYLE_DIM, "%6.4g", l->low);
    if (r.rows > 1 && p && isfinite(p->y[ch]))
        canvas_print(c, r.row + r.rows / 2, r.col, LABEL_COLS, trace_style(ch), "%9.4f",
                     (double)p->y[ch]);
    for (int k = 0; k < r.rows; k++)
        canvas_put(c, r.row + k, r.col + LABEL_COLS - 1, 0x2502, STYLE_DIM);
}

static void draw_lane(struct scope *s, const struct span *v, struct canvas *c, struct tui_rect r,
                      int ch)
{
    struct lane l = {.s = s, .v = *v};
    struct tui_rect plot = {r.row, r.col + LABEL_COLS, r.rows, r.cols - LABEL_COLS};
    choose_range(s, v, ch, &l.low, &l.high);
    if (dots_init(&l.d, plot.rows, plot.cols) != MK_OK)
        return;
    draw_marks(&l, c, plot, ch);
    if (s->has_model && ch <= CH_Q2)
        draw_trace(&l, ch == CH_Q1 ? CH_MODEL1 : CH_MODEL2, STYLE_TRACE_D, true);
    if (ch == CH_V1 && s->has_ref && s->plant && s->plant->joint_is_wheel[0])
        draw_trace(&l, CH_REF, STYLE_TRACE_D, true); /* what the speed should be */
    draw_trace(&l, ch, trace_style(ch), false);
    dots_show(&l.d, c, plot.row, plot.col);
    dots_free(&l.d);
    draw_label(&l, c, r, ch);
}

/* Ticks at round times. */
static void draw_time_axis(const struct span *v, struct canvas *c, struct tui_rect r)
{
    int left = r.col + LABEL_COLS, width = r.cols - LABEL_COLS;
    double span = v->t1 - v->t0, step = round_up(span * 10.0 / width);
    for (int j = 0; j < width; j++)
        canvas_put(c, r.row, left + j, 0x2500, STYLE_DIM);
    canvas_text(c, r.row, r.col, LABEL_COLS, STYLE_DIM, "  seconds");
    double first = step * ceil(v->t0 / step);
    for (int k = 0; k < width && first + k * step <= v->t1; k++) {
        char text[24];
        double t = first + k * step;
        int at = left + (int)((t - v->t0) / span * (width - 1));
        int n = snprintf(text, sizeof text, "%.6g", fabs(t) < step * 1e-6 ? 0.0 : t);
        canvas_put(c, r.row, at, 0x253c, STYLE_DIM);
        int from = at - n / 2 < left ? left : at - n / 2;
        if (from + n <= left + width)
            canvas_text(c, r.row, from, n, STYLE_DIM, text);
    }
}

void scope_draw(struct scope *s, struct canvas *c, struct tui_rect r)
{
    int lanes = 0, drawn = 0;
    for (int ch = 0; ch < CH_COUNT; ch++)
        lanes += is_shown(s, ch);
    int rows = r.rows - 1; /* the axis has the last */
    if (lanes == 0 || rows < lanes || r.cols < LABEL_COLS + 10)
        return;
    struct span v = span_in_view(s);
    for (int ch = 0; ch < CH_COUNT; ch++) {
        if (!is_shown(s, ch))
            continue;
        int from = drawn * rows / lanes, to = (drawn + 1) * rows / lanes;
        /* Lanes are kept apart by a row where there is room. */
        int gap = rows / lanes > 4 && drawn + 1 < lanes;
        struct tui_rect lane = {r.row + from, r.col, to - from - gap, r.cols};
        draw_lane(s, &v, c, lane, ch);
        drawn++;
    }
    draw_time_axis(&v, c, (struct tui_rect){r.row + rows, r.col, 1, r.cols});
}

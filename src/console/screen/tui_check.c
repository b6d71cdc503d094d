/* What to look at before a start: a list that says what is well and what is not. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "console/screen/tui.h"
#include "console/script/fault_text.h"

#define LINES_MAX 3 /* of a point */

enum verdict { WELL, LOOK, WRONG };

struct list {
    struct canvas *c;
    struct tui_rect r;
    int row;
};

static void line(struct list *l, enum verdict v, const char *what, const char *fmt, ...)
    MK_PRINTF(4, 5);
static void line(struct list *l, enum verdict v, const char *what, const char *fmt, ...)
{
    static const struct {
        const char *mark;
        enum tui_style style;
    } marks[] = {{"ok", STYLE_GOOD}, {"--", STYLE_WARN}, {"NO", STYLE_BAD}};
    char text[200];
    va_list args;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    if (l->row >= l->r.rows)
        return;
    int row = l->r.row + l->row++;
    canvas_text(l->c, row, l->r.col + 1, 2, marks[v].style, marks[v].mark);
    canvas_text(l->c, row, l->r.col + 5, 10, STYLE_TITLE, what);
    int room = l->r.rows - l->row + 1, most = room < LINES_MAX ? room : LINES_MAX;
    struct tui_rect rest = {row, l->r.col + 16, most, l->r.cols - 17};
    int lines = canvas_wrap(l->c, rest, STYLE_NORMAL, text);
    l->row += lines > most ? most - 1 : lines > 1 ? lines - 1 : 0;
}

static void check_links(struct list *l, const struct host_status *st)
{
    const struct mk_plant_info *plant = mk_plant(st->model.plant);
    if (st->fast) {
        line(l, WELL, "links", "simulated time: they hang still at the start");
        return;
    }
    if (!st->looked) {
        line(l, WRONG, "links", "the encoders cannot be read");
        return;
    }
    line(l, st->still ? WELL : LOOK, "still",
         st->still ? "nothing has moved for half a second" : "something moves: wait");
    double off = 0.0;
    for (int j = 0; j < plant->joints; j++)
        if (!plant->joint_is_wheel[j] && isfinite(st->config.limits.rest_tolerance[j])) {
            double from_rest = st->q[j] - plant->rest[j];
            if (!st->model.joint_linear[j])
                from_rest = remainder(from_rest, 2.0 * M_PI);
            off = fmax(off, fabs(from_rest) / mk_model_joint_scale(&st->model, j));
        }
    if (!st->zeroed)
        line(l, LOOK, "zero",
             "the first start takes the links to hang straight down and zeroes the encoders there: "
             "look at the rig");
    else
        line(l, off < 0.05 ? WELL : WRONG, "hanging", "%.3f rad from where it was zeroed", off);
}

static void range(char *buf, size_t size, const char *unit, double low, double high)
{
    if (isinf(low) && isinf(high))
        snprintf(buf, size, "free");
    else
        snprintf(buf, size, "%.3g .. %.3g %s", low, high, unit);
}

static void check_limits(struct list *l, const struct host_status *st)
{
    const struct mk_safety_limits *s = &st->config.limits;
    const struct mk_model *m = &st->model;
    const char *fast = mk_model_unit(m, 0, "rad/s"), *other = mk_model_unit(m, 1, "rad/s");
    const bool same = strcmp(fast, other) == 0;
    char travel[2][48];
    for (int j = 0; j < 2; j++)
        range(travel[j], sizeof travel[j], mk_model_unit(m, j, "rad"), s->q_min[j], s->q_max[j]);
    if (mk_plant(st->model.plant)->joints == 2)
        line(l, WELL, "limits", "q1 %s, q2 %s, speeds %.3g%s%s and %.3g %s", travel[0], travel[1],
             s->v_max[0], same ? "" : " ", same ? "" : fast, s->v_max[1], other);
    else
        line(l, WELL, "limits", "q1 %s, speed %.3g %s", travel[0], s->v_max[0], fast);
}

static void check_log(struct list *l, const struct host_status *st)
{
    if (st->disk_free_mb < 0.0)
        line(l, WRONG, "disk", "logs cannot be written to the folder of --out");
    else if (st->disk_free_mb < 100.0)
        line(l, WRONG, "disk", "%.0f MB left for logs", st->disk_free_mb);
    else
        line(l, WELL, "disk", "%.1f GB left for logs", st->disk_free_mb / 1000.0);
}

static void check_fault(struct list *l, const struct host_status *st)
{
    char value[FAULT_VALUE_SIZE];
    fault_value(&st->snap, &st->config.limits, &st->model, value, sizeof value);
    line(l, WRONG, "fault", "%s: %s%s%s; a acknowledges", mk_fault_name(st->snap.fault),
         mk_fault_text(st->snap.fault), value[0] ? ": " : "", value);
}

static bool is_faulted(const struct host_status *st)
{
    return st->have_loop && st->snap.state == MK_LOOP_FAULTED;
}

void tui_draw_check(struct tui *t, struct tui_rect r)
{
    const struct host_status *st = &t->status;
    struct list l = {&t->canvas, r, 0};
    if (!st->setup) {
        canvas_wrap(l.c, (struct tui_rect){r.row + 1, r.col + 2, r.rows - 1, r.cols - 4},
                    STYLE_NORMAL,
                    "Press s and choose a setup: what is run, on which rig.\n\n"
                    "Then this place says whether all is well for a start; r starts, Space stops "
                    "the motor at once, ? lists all keys.");
        return;
    }
    line(&l, WELL, "setup", "%s: %s", st->setup->name, st->setup->help);
    line(&l, WELL, "board", "%s, %.0f samples a second", st->backend->name, st->config.rate_hz);
    if (is_faulted(st))
        check_fault(&l, st);
    check_links(&l, st);
    check_limits(&l, st);
    check_log(&l, st);
    l.row++;
    if (l.row < r.rows && !is_faulted(st))
        canvas_text(l.c, r.row + l.row, r.col + 1, r.cols - 1, STYLE_KEY,
                    "r starts; keep a hand on Space: it stops the motor");
}

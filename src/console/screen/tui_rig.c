#include "console/screen/tui_rig.h"

#include <math.h>

#include "model/plant_facts.h"

/* Directions below are angles from the downward vertical, counter-clockwise. */
struct pen {
    struct dots d;
    double x, y;  /* dots */
    double scale; /* dots of the longest link */
};

static void move_along(struct pen *p, double angle, double length)
{
    p->x += p->scale * length * sin(angle);
    p->y += p->scale * length * cos(angle);
}

/* Two dots wide, so that a link is not taken for a trace. */
static void rod_to(struct pen *p, double angle, double length, enum tui_style style)
{
    double x = p->x, y = p->y, across = fabs(sin(angle)) > 0.7 ? 0.0 : 1.0;
    move_along(p, angle, length);
    dots_line(&p->d, x, y, p->x, p->y, style);
    dots_line(&p->d, x + across, y + 1.0 - across, p->x + across, p->y + 1.0 - across, style);
}

/* Hollow: what lies behind it is seen. */
static void link_to(struct pen *p, double angle, double length, enum tui_style style)
{
    double x = p->x, y = p->y, dx = 2.0 * cos(angle), dy = -2.0 * sin(angle);
    move_along(p, angle, length);
    for (int side = -1; side <= 1; side += 2)
        dots_line(&p->d, x + side * dx, y + side * dy, p->x + side * dx, p->y + side * dy, style);
    dots_line(&p->d, p->x - dx, p->y - dy, p->x + dx, p->y + dy, style);
}

static void wheel_at(struct pen *p, double angle, double radius, enum tui_style style)
{
    struct pen spoke = *p;
    dots_circle(&p->d, p->x, p->y, radius * p->scale, style);
    move_along(&spoke, angle, radius);
    dots_line(&p->d, p->x, p->y, spoke.x, spoke.y, style);
}

static void ground(struct pen *p)
{
    for (int k = -3; k <= 3; k++)
        dots_set(&p->d, (int)p->x + k, (int)p->y, STYLE_DIM);
    dots_set(&p->d, (int)p->x, (int)p->y - 1, STYLE_DIM);
    dots_set(&p->d, (int)p->x, (int)p->y + 1, STYLE_DIM);
}

/* An arm from above, in the corner. */
static void dial(const struct pen *p, double angle, double length, enum tui_style style)
{
    struct pen dial = *p;
    dial.scale = p->scale * 0.45;
    dial.x = dial.scale + 1.0;
    dial.y = dial.scale + 1.0;
    dots_circle(&dial.d, dial.x, dial.y, dial.scale * length, STYLE_DIM);
    rod_to(&dial, angle, length, style);
}

/* A box on a line across the picture; the pen goes to the box. */
static void carriage(struct pen *p, double along, enum tui_style style)
{
    const double half = 0.25 * p->scale, low = 0.12 * p->scale;
    dots_line(&p->d, p->x - 2.0 * p->scale, p->y + low + 1.0, p->x + 2.0 * p->scale,
              p->y + low + 1.0, STYLE_DIM);
    p->x += p->scale * along;
    for (int side = -1; side <= 1; side += 2) {
        dots_line(&p->d, p->x - half, p->y + side * low, p->x + half, p->y + side * low, style);
        dots_line(&p->d, p->x + side * half, p->y - low, p->x + side * half, p->y + low, style);
    }
}

static void stroke(struct pen *p, const struct mk_stroke *s)
{
    enum tui_style style = s->joint == 0 ? STYLE_TRACE_A : STYLE_TRACE_B;
    switch (s->kind) {
    case MK_STROKE_GROUND:
        ground(p);
        break;
    case MK_STROKE_LINK:
        link_to(p, s->angle, s->length, style);
        break;
    case MK_STROKE_ROD:
        rod_to(p, s->angle, s->length, style);
        break;
    case MK_STROKE_WHEEL:
        wheel_at(p, s->angle, s->length, style);
        break;
    case MK_STROKE_DIAL:
        dial(p, s->angle, s->length, style);
        break;
    case MK_STROKE_CARRIAGE:
        carriage(p, s->length, style);
        break;
    }
}

void rig_draw(struct canvas *c, struct tui_rect r, enum mk_plant_kind plant, const double *q)
{
    struct pen p;
    struct mk_stroke strokes[MK_SKETCH_MAX];
    if (r.rows < 3 || r.cols < 6 || dots_init(&p.d, r.rows, r.cols) != MK_OK)
        return;
    p.x = r.cols;
    p.y = 2.0 * r.rows;
    p.scale = fmin(p.x, p.y) / 2.0 - 0.5;
    int count = mk_plant_sketch(plant, q, strokes);
    for (int i = 0; i < count; i++)
        stroke(&p, &strokes[i]);
    dots_show(&p.d, c, r.row, r.col);
    dots_free(&p.d);
}

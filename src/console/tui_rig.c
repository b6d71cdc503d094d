#include "console/tui_rig.h"

#include <math.h>

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

static void draw_pendubot(struct pen *p, const double *q)
{
    const double quarter = 1.57079632679489662;
    ground(p);
    link_to(p, q[0] + quarter, 1.0, STYLE_TRACE_A);
    rod_to(p, q[0] + q[1] + quarter, 0.95, STYLE_TRACE_B);
}

/* From the front, at the tip of the arm; the arm from above beside it. */
static void draw_furuta(struct pen *p, const double *q)
{
    struct pen dial = *p;
    dial.scale = p->scale * 0.45;
    dial.x = dial.scale + 1.0;
    dial.y = dial.scale + 1.0;
    dots_circle(&dial.d, dial.x, dial.y, dial.scale, STYLE_DIM);
    rod_to(&dial, q[0], 1.0, STYLE_TRACE_A);
    ground(p);
    rod_to(p, 3.14159265358979324 - q[1], 1.9, STYLE_TRACE_B);
}

static void draw_reaction_wheel(struct pen *p, const double *q)
{
    ground(p);
    rod_to(p, q[0], 1.4, STYLE_TRACE_A);
    wheel_at(p, q[0] + q[1], 0.5, STYLE_TRACE_B);
}

void rig_draw(struct canvas *c, struct tui_rect r, enum mk_plant_kind plant, const double *q)
{
    struct pen p;
    if (r.rows < 3 || r.cols < 6 || dots_init(&p.d, r.rows, r.cols) != MK_OK)
        return;
    p.x = r.cols;
    p.y = 2.0 * r.rows;
    p.scale = fmin(p.x, p.y) / 2.0 - 0.5;
    switch (plant) {
    case MK_PLANT_PENDUBOT:
        draw_pendubot(&p, q);
        break;
    case MK_PLANT_FURUTA:
        draw_furuta(&p, q);
        break;
    case MK_PLANT_REACTION_WHEEL:
        draw_reaction_wheel(&p, q);
        break;
    case MK_PLANT_PENDULUM:
        ground(&p);
        rod_to(&p, q[0], 1.9, STYLE_TRACE_A);
        break;
    default:
        wheel_at(&p, q[0], 1.8, STYLE_TRACE_A);
        break;
    }
    dots_show(&p.d, c, r.row, r.col);
    dots_free(&p.d);
}

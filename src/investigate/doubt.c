#include "investigate/doubt.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "mechkit/loop.h"
#include "mechkit/sim.h"

#define STILL_ROWS 8    /* readings that are the same, at least */
#define SPEED_ROWS 5    /* that a speed is taken from */
#define SURE_COUNTS 4.0 /* that a joint must have gone meanwhile */
#define MODEL_TIMES 2.0 /* as fast as the model can, its values may be off */

static const char *const angle[MK_MAX_JOINTS] = {"q1", "q2"};
static const char *const speed[MK_MAX_JOINTS] = {"dq1", "dq2"};

/* The row that saw the fault; all of them: there is none. */
static size_t fault_row(const struct mk_log *log)
{
    const double *flags = mk_log_get(log, "flags");
    for (size_t k = 0; flags && k < log->rows; k++)
        if (flags[k] >= 0.0 && (unsigned)flags[k] & MK_FLAG_FAULT)
            return k;
    return log->rows;
}

static bool is_of(const char *noted, enum mk_fault fault)
{
    const char *name = mk_fault_name(fault);
    const size_t n = strlen(name);
    return strncmp(noted, name, n) == 0 && noted[n] == ' ';
}

/* How many of the first `rows` rows end with a reading that is another than the one before. */
static size_t until_it_stood_still(const double *q, size_t rows)
{
    size_t last = rows; /* the newest reading that there is */
    for (size_t k = rows; k-- > 0;) {
        if (isnan(q[k]))
            continue;
        if (last < rows && q[k] != q[last])
            return last + 1;
        last = k;
    }
    return 0;
}

/* --- a reading that stood still unseen -------------------------------------------------------- */

struct columns {
    size_t rows;
    const double *t, *u, *q[MK_MAX_JOINTS], *v[MK_MAX_JOINTS];
};

static bool take_columns(const struct mk_log *log, const struct mk_model *model, size_t rows,
                         struct columns *c)
{
    *c = (struct columns){rows, mk_log_get(log, "t"), mk_log_get(log, "u"), {NULL}, {NULL}};
    bool all = c->t && c->u;
    for (int j = 0; j < mk_model_joints(model); j++) {
        c->q[j] = mk_log_get(log, angle[j]);
        c->v[j] = mk_log_get(log, speed[j]);
        all = all && c->q[j] && c->v[j];
    }
    return all;
}

/* What joint j can be accelerated by, with the command and the motion of a row. */
static double most_acceleration(const struct columns *c, const struct mk_model *model, size_t row,
                                int j)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    double mass[MK_MAX_JOINTS * MK_MAX_JOINTS], h[MK_MAX_JOINTS], q[MK_MAX_JOINTS] = {0},
                                                                  v[MK_MAX_JOINTS] = {0};
    for (int i = 0; i < plant->joints; i++) {
        q[i] = c->q[i][row];
        v[i] = c->v[i][row];
    }
    mk_plant_mass(model, q, v, mass, h);
    h[plant->motor_joint] = fabs(h[plant->motor_joint]) + fabs(c->u[row]);
    if (plant->joints == 1)
        return MODEL_TIMES * h[0] / mass[0];
    const double det = mass[0] * mass[3] - mass[1] * mass[2];
    const double own = mass[j == 0 ? 3 : 0], other = mass[1];
    return MODEL_TIMES * (fabs(own * h[j]) + fabs(other * h[1 - j])) / fabs(det);
}

/* Whether joint j, which had at least the speed between two rows, must have gone on by many counts
 * in the time that its reading stood still beside them. */
static bool must_have_gone(const struct columns *c, const struct mk_model *model, int j,
                           size_t from, size_t to, double still_s)
{
    const double count = mk_model_count(model, j), span = c->t[to] - c->t[from];
    const double a = fmax(most_acceleration(c, model, from, j), most_acceleration(c, model, to, j));
    const double v = (fabs(c->q[j][to] - c->q[j][from]) - count) / span - 0.5 * a * span;
    if (!(v > 0.0) || !isfinite(a)) /* a reading, or a command, that is lost says nothing */
        return false;
    const double brakes_s = fmin(still_s, v / a);
    return v * brakes_s - 0.5 * a * brakes_s * brakes_s > SURE_COUNTS * count;
}

/* The first row from which on joint j's reading stood still though it cannot have; all: none. */
static size_t frozen_from(const struct columns *c, const struct mk_model *model, int j)
{
    const double *q = c->q[j];
    for (size_t first = 0, last; first < c->rows; first = last + 1) {
        for (last = first; last + 1 < c->rows && q[last + 1] == q[first]; last++)
            ;
        if (last - first + 1 < STILL_ROWS)
            continue;
        const double still_s = c->t[last] - c->t[first];
        if (first >= SPEED_ROWS && must_have_gone(c, model, j, first - SPEED_ROWS, first, still_s))
            return first;
        if (last + 1 + SPEED_ROWS < c->rows &&
            must_have_gone(c, model, j, last + 1, last + 1 + SPEED_ROWS, still_s))
            return first;
    }
    return c->rows;
}

/* --- both ------------------------------------------------------------------------------------- */

/* How many rows are left of those before a fault. */
static size_t before_the_fault(const struct mk_log *log, const struct mk_model *model)
{
    const char *noted = mk_log_find_meta(log, "fault");
    size_t rows = fault_row(log);
    int joint = 0; /* 1-based; 0: any */
    if (rows == log->rows || !noted ||
        !(is_of(noted, MK_FAULT_STUCK) || is_of(noted, MK_FAULT_JUMP)))
        return rows;
    const char *told = strstr(noted, " joint ");
    (void)(told && sscanf(told, " joint %d", &joint));
    for (int j = 0; j < mk_model_joints(model); j++) {
        const double *q = mk_log_get(log, angle[j]);
        if (q && (joint == 0 || joint == j + 1)) {
            const size_t moved = until_it_stood_still(q, rows);
            rows = moved < rows ? moved : rows;
        }
    }
    return rows;
}

struct doubt doubt_cut(struct mk_log *log, const struct mk_model *model)
{
    struct doubt found = {0, 0.0};
    struct columns c;
    log->rows = before_the_fault(log, model);
    if (!take_columns(log, model, log->rows, &c))
        return found;
    for (int j = 0; j < mk_model_joints(model); j++) {
        const size_t first = frozen_from(&c, model, j);
        if (first < log->rows) {
            found = (struct doubt){j + 1, c.t[first]};
            log->rows = first + 1;
        }
    }
    return found;
}

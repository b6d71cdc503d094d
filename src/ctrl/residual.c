/* See residual.h. All of this file is RT. */
#include "ctrl/residual.h"

#include <math.h>
#include <string.h>

/* Speeds that come with readings lag and carry the noise of counts: they are right to within a
 * share and an offset (rad/s, times the joint's scale). */
#define SPEED_SHARE 0.1
#define SPEED_OFFSET 0.5

/* A command may act so many samples later than it is in force; where the motor turns a joint round
 * within them, its reading stands still for as long. */
#define TURNING_SAMPLES 2.0

/* A jump: so many counts beyond where the last readings lead, and so many times their noise, the
 * mean square of which is taken over this time; a stop that is hit turns a speed round, and the
 * speed of a few samples ago is off by what the joint has accelerated since, of which this many
 * times are believed. */
#define JUMP_COUNTS 20.0
#define JUMP_NOISE 6.0
#define NOISE_S 0.1
#define JUMP_REBOUND 2.5
#define JUMP_SHARE 1.127
/* Samples that are missing are predicted across for as long as a board that hears nothing keeps its
 * motor on, and a little more. */
#define GAP_S 0.025
#define MOST_SAMPLES 1e6

/* A motor joint that is driven by something else: the speed that the model knows nothing of is kept
 * for this time, and is a fault where it takes this share of all that the motor can do. The speeds
 * of readings lag by four samples: the time has so many at least. */
#define DRIVEN_S 0.05
#define DRIVEN_SAMPLES 25.0
#define DRIVEN_SHARE 0.4

/* Share of the reserve at a joint that has neither motor nor gears. */
#define FREE_RESERVE 0.3

/* The reserve grows so many times where effects with states of their own (a bristle, a backlash)
 * may hold what the equations at rest let go. */
#define HIDDEN_RESERVE 5.0

/* Breakaway against the Coulomb friction that the model knows. */
#define BREAKAWAY 1.5

/* Sway: above this frequency, as a mean square over this time, of so many counts of the joint
 * itself and, carried over, of the other one. */
#define SWAY_CORNER_RADPS 6.0
#define SWAY_S 0.3
#define SWAY_COUNTS 5.0
#define SWAY_OTHER_COUNTS 3.0
/* A count of the other joint is the more speed the closer samples are: closer than this its speed
 * is smoothed until a count is as much as then. */
#define SWAY_SAMPLE_S 0.002

/* So much more of the other joint's counts where a way is added up without forgetting. */
#define SURE_CARRIED 4.0

/* An element of the mass matrix below this share of the diagonal couples nothing. */
#define LEAST_COUPLING 1e-3

/* The motor counts as driving from this share of its limit on, and for so long after. */
#define DRIVES_SHARE 0.02
#define DRIVES_S 0.5

/* A rig that is balanced counts all the time: over 4.4 h on 1200 rigs of six setups it paused once
 * for longer than this. A nudge is this share of the motor's limit beyond all that may hold the
 * rig. */
#define NUDGE_AFTER_S 1.0
#define NUDGE_SHARE 0.05

/* An acceleration, how far it may be off, and how much of it the motor can make. */
struct bounded {
    double a, off, authority;
};

/* Joint j's acceleration from the other joint's motion: a - ratio * (the other's acceleration). */
struct sway_of {
    bool known;
    double a, off, ratio;
};

void mk_residual_reset(struct mk_residual *r)
{
    memset(r->joint, 0, sizeof r->joint);
    memset(&r->rest, 0, sizeof r->rest);
    r->u = r->drives_for = 0.0;
    r->balances = false;
}

void mk_residual_init(struct mk_residual *r, const struct mk_model *model,
                      const struct mk_safety_limits *limits)
{
    r->model = model;
    r->limits = limits;
    r->plant = *model;
    r->plant.effect_count = 0;
    r->smooth = mk_model_is_smooth(model);
    mk_residual_reset(r);
}

/* --- what the model says ---------------------------------------------------------------------- */

static void plant_acceleration(const struct mk_residual *r, const double *q, const double *v,
                               double *a)
{
    double tau[MK_MAX_JOINTS] = {0.0, 0.0};
    tau[mk_plant(r->plant.plant)->motor_joint] = r->u;
    mk_plant_acceleration(&r->plant, q, v, tau, a);
}

static double reserve_at(const struct mk_residual *r, int joint)
{
    bool driven = joint == mk_plant(r->plant.plant)->motor_joint;
    double reserve = r->limits->model_reserve * (r->smooth ? 1.0 : HIDDEN_RESERVE);
    return reserve * (driven ? 1.0 : FREE_RESERVE);
}

/* By how much each row of the equations of motion may be off, in torque: every term of Phi p by the
 * share that its parameter may be off by, the motor joint's friction at rest, and the reserve. */
static void torque_off(const struct mk_residual *r, const double *q, const double *v,
                       const double *a, double *off)
{
    const struct mk_plant_info *plant = mk_plant(r->plant.plant);
    double phi[MK_MAX_JOINTS * MK_MAX_PARAMETERS];
    int n = plant->parameter_count;
    mk_plant_regressor(&r->plant, q, v, a, phi);
    for (int i = 0; i < plant->joints; i++) {
        off[i] = reserve_at(r, i);
        for (int p = 0; p < n; p++)
            off[i] += r->limits->model_share * fabs(phi[i * n + p] * r->plant.parameter[p]);
    }
    double coulomb = r->plant.parameter[n - 1]; /* of every plant the last */
    off[plant->motor_joint] += BREAKAWAY * coulomb;
}

/* What a torque at each joint does to the acceleration of joint j: its row of |M^-1|. */
static void mobility(const struct mk_residual *r, const double *q, const double *v, int j,
                     double *out)
{
    double mass[MK_MAX_JOINTS * MK_MAX_JOINTS], h[MK_MAX_JOINTS];
    mk_plant_mass(&r->plant, q, v, mass, h);
    if (mk_plant(r->plant.plant)->joints == 1) {
        out[0] = 1.0 / mass[0];
        out[1] = 0.0;
        return;
    }
    double det = mass[0] * mass[3] - mass[1] * mass[2];
    out[0] = out[1] = fabs(mass[1] / det);
    out[j] = fabs(mass[3 - 3 * j] / det);
}

/* What the other joint's speed, not quite known, makes of joint j's acceleration a. */
static double speed_off(const struct mk_residual *r, const double *q, const double *v, double a,
                        int j)
{
    double off = 0.0;
    int other = 1 - j;
    if (mk_plant(r->plant.plant)->joints == 1)
        return 0.0;
    double dv =
        SPEED_SHARE * fabs(v[other]) + SPEED_OFFSET * mk_model_joint_scale(&r->plant, other);
    for (int side = -1; side <= 1; side += 2) {
        double w[MK_MAX_JOINTS] = {v[0], v[1]}, b[MK_MAX_JOINTS];
        w[other] += side * dv;
        plant_acceleration(r, q, w, b);
        off = fmax(off, fabs(b[j] - a));
    }
    return off;
}

/* What effects make of it: all that they do, at rest and in slow motion, counts as unknown. */
static double effects_off(const struct mk_residual *r, double t, const double *q, const double *v,
                          int j)
{
    double off = 0.0, u[MK_MAX_INPUTS] = {r->u, 0.0};
    int n = mk_plant(r->plant.plant)->joints;
    if (r->model->effect_count == 0)
        return 0.0;
    for (int side = -1; side <= 1; side++) {
        double w[MK_MAX_JOINTS] = {v[0], v[1]}, a[MK_MAX_JOINTS];
        double x[MK_MAX_STATES], dx[MK_MAX_STATES];
        w[j] += side * SPEED_OFFSET * mk_model_joint_scale(r->model, j);
        plant_acceleration(r, q, w, a);
        mk_model_initial_state(r->model, q, w, x);
        mk_model_rhs(r->model, t, x, u, dx);
        off = fmax(off, fabs(dx[n + j] - a[j]));
    }
    return off;
}

/* Acceleration of joint j if it is where its reading says and moves at `speed`. */
static struct bounded accelerate(const struct mk_residual *r, double t, const double *q,
                                 const double *v, int j, double speed)
{
    double w[MK_MAX_JOINTS] = {v[0], v[1]}, a[MK_MAX_JOINTS] = {0.0, 0.0};
    w[j] = speed;
    double mobile[MK_MAX_JOINTS], off[MK_MAX_JOINTS] = {0.0, 0.0};
    plant_acceleration(r, q, w, a);
    struct bounded b = {.a = a[j]};
    a[j] = 0.0; /* what speaks against rest: an inertia that is off changes how much, not whether */
    mobility(r, q, w, j, mobile);
    torque_off(r, q, w, a, off);
    b.off = mobile[0] * off[0] + mobile[1] * off[1] + speed_off(r, q, w, b.a, j) +
            effects_off(r, t, q, w, j);
    b.authority = mobile[mk_plant(r->plant.plant)->motor_joint] * r->plant.u_max;
    return b;
}

/* --- a reading that stands still ------------------------------------------------------------- */

/* The speed that joint j had at its last change, as little of it as can be: less what a count and
 * its acceleration can make of it, whatever the command has been of late. */
static void begin_with_speed(struct mk_residual_joint *s, double dt, double count, struct bounded b)
{
    memset(s->sure, 0, sizeof s->sure);
    if (s->known < MK_RESIDUAL_PAST)
        return;
    double span = dt * (MK_RESIDUAL_PAST - 1);
    double v = (s->past[0] - s->past[MK_RESIDUAL_PAST - 1]) / span;
    double sure = fabs(v) - count / span - span * (fabs(b.a) + b.off + b.authority);
    if (sure > 0.0)
        s->sure[v < 0.0].speed = sure;
}

/* One more sample of a motion whose speed changes by `gain`, give or take `off`. Returns how far
 * the joint must have gone, either way. */
static double go_on(struct mk_residual_sure sure[2], double gain, double off, double dt,
                    const struct mk_residual *r)
{
    double heavier = 1.0 + r->limits->model_share;
    for (int side = 0; side < 2; side++) {
        struct mk_residual_sure *s = &sure[side];
        double push = (side == 0 ? gain : -gain) - off;
        s->speed = fmax(s->speed + push / heavier, 0.0);
        s->way = s->speed > 0.0 ? s->way + s->speed * dt : 0.0;
    }
    return fmax(sure[0].way, sure[1].way);
}

/* Whether joint j, unmoved for one more sample, must have moved. */
static bool must_have_moved(const struct mk_residual *r, struct mk_residual_joint *s, double t,
                            double dt, const double *q, const double *v, int j)
{
    double speed = s->fresh ? 0.0 : s->sure[0].speed - s->sure[1].speed;
    struct bounded b = accelerate(r, t, q, v, j, speed);
    if (s->fresh)
        begin_with_speed(s, dt, mk_model_count(r->model, j), b);
    s->fresh = false;
    double swing = b.authority * (TURNING_SAMPLES * dt) * (TURNING_SAMPLES * dt);
    double way = go_on(s->sure, b.a * dt, b.off * dt, dt, r);
    return way > fmax(r->limits->still_way[j], swing);
}

/* --- a reading that stands still while the rig sways
 *
 * The equation of the joint without a motor, row i of M a + h = 0, knows neither the command nor
 * the motor's friction. It gives joint j's acceleration from the other joint k's motion:
 *
 *     a_j = -(M_ik a_k + h_i) / M_ij
 *
 * A constant part may be a wrong angle or a tilted base and is taken out; a_k is never formed, for
 * it is the change of a speed, and joint j's speed is what is wanted. */

static struct sway_of sway_of(const struct mk_residual *r, const double *q, const double *v, int j)
{
    double mass[MK_MAX_JOINTS * MK_MAX_JOINTS], h[MK_MAX_JOINTS], w[MK_MAX_JOINTS] = {v[0], v[1]};
    int k = 1 - j, row = 1 - mk_plant(r->plant.plant)->motor_joint;
    w[j] = 0.0;
    mk_plant_mass(&r->plant, q, w, mass, h);
    double divisor = mass[2 * row + j];
    struct sway_of out = {.known = fabs(divisor) > LEAST_COUPLING * mass[2 * row + row]};
    out.ratio = out.known ? mass[2 * row + k] / divisor : 0.0;
    out.a = out.known ? -h[row] / divisor : 0.0;
    out.off = (r->limits->model_share * fabs(h[row]) + reserve_at(r, row)) / fabs(divisor);
    return out;
}

static bool must_have_swayed(const struct mk_residual *r, struct mk_residual_sway *s, double dt,
                             const double *q, const double *v, int j)
{
    int k = 1 - j;
    double other_v = r->joint[k].smooth_v;
    if (mk_plant(r->plant.plant)->joints == 1)
        return false;
    struct sway_of now = sway_of(r, q, v, j);
    if (s->still_s == 0.0 || !now.known) {
        *s = (struct mk_residual_sway){.other_v = other_v, .mean_a = now.a, .still_s = dt};
        return false;
    }
    double step = now.ratio * (other_v - s->other_v), forget = dt / SWAY_S;
    double off = now.off * dt + r->limits->model_share * fabs(step);
    double way = go_on(s->sure, now.a * dt - step, off, dt, r);
    double keep = 1.0 - SWAY_CORNER_RADPS * dt;
    s->speed = keep * (s->speed + (now.a - s->mean_a) * dt - step);
    s->way = keep * (s->way + s->speed * dt);
    s->mean_a += forget * (now.a - s->mean_a);
    s->mean_way += forget * (s->way - s->mean_way);
    double sway = s->way - s->mean_way;
    s->square += forget * (sway * sway - s->square);
    s->other_v = other_v;
    s->still_s += dt;
    double own = mk_model_count(r->model, j);
    double carried = SWAY_OTHER_COUNTS * fabs(now.ratio) * mk_model_count(r->model, k);
    double least = SWAY_COUNTS * own + carried;
    /* Of the motor joint the row says too little: there it is divided by the coupling. */
    bool moved = j != mk_plant(r->plant.plant)->motor_joint &&
                 way > r->limits->still_way[j] + SURE_CARRIED * carried;
    return moved || (s->still_s >= SWAY_S && s->square > least * least);
}

/* --- readings that all stand still
 *
 * Then nothing is known of any joint's motion but that there should be none: M a + h = tau with
 * v = 0, and each row says what torque is left to set the rig in motion. Integrated once that is
 * the row's momentum, (M v)_i, and twice M q, of which the readings allow no more than every joint
 * has within still_way. Where the command is too small to say anything, but the controller holds an
 * upright, the rig is nudged until it says something: a count, or that it cannot. A nudge takes the
 * place of the controller's command, for a controller that knows its command would work against it.
 */

/* What effects do to each row in a motion w. */
static void effects_torque(const struct mk_residual *r, double t, const double *q, const double *w,
                           const double *mass, double *torque)
{
    double u[MK_MAX_INPUTS] = {r->u, 0.0}, a[MK_MAX_JOINTS];
    double x[MK_MAX_STATES], dx[MK_MAX_STATES];
    int n = mk_plant(r->plant.plant)->joints;
    plant_acceleration(r, q, w, a);
    mk_model_initial_state(r->model, q, w, x);
    mk_model_rhs(r->model, t, x, u, dx);
    for (int i = 0; i < n; i++) {
        torque[i] = 0.0;
        for (int j = 0; j < n; j++)
            torque[i] += mass[n * i + j] * (dx[n + j] - a[j]);
    }
}

/* Adds the most that effects do to each row of two at rest: in slow motion, either way. */
static void add_slow_effects(const struct mk_residual *r, double t, const double *q,
                             const double *mass, double *off)
{
    double most[MK_MAX_JOINTS] = {0.0, 0.0};
    for (int corner = 0; corner < 4 && r->model->effect_count > 0; corner++) {
        double torque[MK_MAX_JOINTS];
        const double w[MK_MAX_JOINTS] = {
            (corner % 2 ? 1.0 : -1.0) * SPEED_OFFSET * mk_model_joint_scale(r->model, 0),
            (corner / 2 ? 1.0 : -1.0) * SPEED_OFFSET * mk_model_joint_scale(r->model, 1)};
        effects_torque(r, t, q, w, mass, torque);
        for (int i = 0; i < MK_MAX_JOINTS; i++)
            most[i] = fmax(most[i], fabs(torque[i]));
    }
    for (int i = 0; i < MK_MAX_JOINTS; i++)
        off[i] += most[i];
}

/* A command that nothing can hold, towards the middle of the travel. `off` is what may hold it at
 * the motor's row, `h` what the model says that does. */
static void nudge(struct mk_residual *r, const double *q, double h, double off)
{
    const struct mk_safety_limits *limits = r->limits;
    int motor = mk_plant(r->plant.plant)->motor_joint;
    bool above = q[motor] > (limits->q_min[motor] + limits->q_max[motor]) / 2.0;
    double size = off + NUDGE_SHARE * r->plant.u_max;
    r->rest.nudges = true;
    r->rest.nudge_u = h + (above ? -size : size);
}

double mk_residual_command(const struct mk_residual *r, double u)
{
    return r->rest.nudges ? r->rest.nudge_u : u;
}

/* Whether a rig of two joints, with no reading changed for one more sample, must have moved. */
static bool cannot_rest(struct mk_residual *r, double t, double dt, const double *q)
{
    const double still[MK_MAX_JOINTS] = {0.0, 0.0};
    double mass[MK_MAX_JOINTS * MK_MAX_JOINTS], h[MK_MAX_JOINTS];
    double off[MK_MAX_JOINTS] = {0.0, 0.0};
    int motor = mk_plant(r->plant.plant)->motor_joint;
    bool moved = false;
    r->rest.still_s = r->balances ? r->rest.still_s + dt : 0.0;
    mk_plant_mass(&r->plant, q, still, mass, h);
    torque_off(r, q, still, still, off);
    add_slow_effects(r, t, q, mass, off);
    for (int i = 0; i < MK_MAX_JOINTS; i++) {
        double push = (i == motor ? r->u : 0.0) - h[i], allowed = 0.0;
        for (int j = 0; j < MK_MAX_JOINTS; j++)
            allowed += fabs(mass[MK_MAX_JOINTS * i + j]) * r->limits->still_way[j];
        double swing = r->plant.u_max * (TURNING_SAMPLES * dt) * (TURNING_SAMPLES * dt);
        double way = go_on(r->rest.row[i], push * dt, off[i] * dt, dt, r);
        moved = moved || way > fmax(allowed, swing);
    }
    r->rest.nudges = false;
    if (r->rest.still_s >= NUDGE_AFTER_S)
        nudge(r, q, h[motor], off[motor]);
    return moved;
}

/* --- a reading that jumps -------------------------------------------------------------------- */

/* No sample is missing since the last one. */
static bool is_regular(const struct mk_residual *r, double dt)
{
    return dt < 1.5 * r->limits->dt_s;
}

/* Samples since the last reading. */
static int samples_since(const struct mk_residual *r, double dt)
{
    return is_regular(r, dt) ? 1 : (int)lround(fmin(dt / r->limits->dt_s, MOST_SAMPLES));
}

static bool jumps(const struct mk_residual *r, struct mk_residual_joint *s, double t, double dt,
                  const double *q, const double *v, int j)
{
    if (s->known < MK_RESIDUAL_PAST || dt > GAP_S + 0.5 * r->limits->dt_s)
        return false;
    int n = samples_since(r, dt);
    double count = mk_model_count(r->model, j), step = (s->past[0] - s->past[2]) / 2.0;
    double off = fabs(q[j] - s->past[0] - n * step);
    double least =
        JUMP_COUNTS * count + JUMP_NOISE * sqrt(s->noise2) + JUMP_REBOUND * n * fabs(step);
    if (n == 1 && s->speed_age == 1.0)
        s->noise2 += dt / NOISE_S * (fmin(off, least) * fmin(off, least) - s->noise2);
    if (off <= least)
        return false;
    double one = dt / n;
    struct bounded b = accelerate(r, t, q, v, j, step / one);
    double reach2 = JUMP_SHARE * dt * (dt / 2.0 + s->speed_age * one);
    return off > least + reach2 * (fabs(b.a) + b.off + b.authority);
}

/* --- a motor joint that is driven by something else
 *
 * The model's speed w follows the reading's v slowly, w' = a + (v - w) / T: so v - w is what was
 * added within T and is not in the model. Only more speed counts: a stop or a hand takes it away.
 */

static bool driven_by_another(const struct mk_residual *r, struct mk_residual_joint *s, double t,
                              double dt, const double *q, const double *v, int j)
{
    struct bounded b = accelerate(r, t, q, v, j, v[j]);
    double kept_s = fmax(DRIVEN_S, DRIVEN_SAMPLES * r->limits->dt_s);
    if (s->known == 0 || !is_regular(r, dt)) /* nobody knows what the command was meanwhile */
        s->model_v = v[j];
    s->model_v += b.a * dt + (v[j] - s->model_v) * dt / kept_s;
    double allowed = kept_s * (DRIVEN_SHARE * b.authority + b.off);
    return (v[j] - s->model_v) * v[j] > 0.0 && fabs(v[j]) > fabs(s->model_v) + allowed;
}

/* --- the sample ------------------------------------------------------------------------------ */

static void push(struct mk_residual_joint *s, double q)
{
    memmove(s->past + 1, s->past, sizeof s->past - sizeof s->past[0]);
    s->past[0] = q;
    s->known += s->known < MK_RESIDUAL_PAST;
}

/* Readings that are missing lie on a straight line, so the speed there is the one amid the gap: it
 * is so much older, until the second reading behind the gap is in. */
static void remember(const struct mk_residual *r, struct mk_residual_joint *s, double dt, double q)
{
    int n = samples_since(r, dt), fill = n < MK_RESIDUAL_PAST ? n : MK_RESIDUAL_PAST;
    double from = s->past[0];
    for (int k = fill - 1; k > 0 && s->known > 0; k--)
        push(s, q - (q - from) * k / n);
    push(s, q);
    if (n > 1) {
        s->speed_age = fmax(s->speed_age, (n + 1) / 2.0);
        s->aged = 2;
    } else if (s->aged == 0 || --s->aged == 0) {
        s->speed_age = 1.0;
    }
}

static void smooth_speeds(struct mk_residual *r, double dt, const double *v)
{
    double closer = dt / SWAY_SAMPLE_S, share = fmin(closer * closer, 1.0);
    for (int j = 0; j < mk_model_joints(r->model); j++)
        r->joint[j].smooth_v += share * (v[j] - r->joint[j].smooth_v);
}

/* A rig that nothing drives may be moved and held by hand. */
static bool drives(struct mk_residual *r, double dt)
{
    if (fabs(r->u) > DRIVES_SHARE * r->model->u_max)
        r->drives_for = DRIVES_S;
    r->drives_for -= dt;
    return r->drives_for > 0.0;
}

static enum mk_fault skip(struct mk_residual_joint *s)
{
    s->fresh = true;
    s->sway.still_s = 0.0;
    return MK_FAULT_NONE;
}

static enum mk_fault check(struct mk_residual *r, double t, double dt, const double *q,
                           const double *v, int j)
{
    struct mk_residual_joint *s = &r->joint[j];
    bool jumped = jumps(r, s, t, dt, q, v, j);
    if (s->known == 0 || q[j] != s->past[0]) {
        skip(s);
        return jumped ? MK_FAULT_JUMP : MK_FAULT_NONE;
    }
    if (!is_regular(r, dt)) /* as there: what is known so far stands */
        return MK_FAULT_NONE;
    bool moved = must_have_moved(r, s, t, dt, q, v, j);
    bool swayed = must_have_swayed(r, &s->sway, dt, q, v, j);
    return moved || swayed ? MK_FAULT_STUCK : MK_FAULT_NONE;
}

static bool all_stand_still(const struct mk_residual *r, const double *q)
{
    bool still = true;
    for (int j = 0; j < mk_model_joints(r->model); j++)
        still = still && r->joint[j].known > 0 && q[j] == r->joint[j].past[0];
    return still;
}

/* Of a single joint must_have_moved() says it all. A controller that holds an upright moves it,
 * even where it needs next to nothing, so then it does not matter how little the motor gives. */
static bool check_rest(struct mk_residual *r, double t, double dt, const double *q, bool drives)
{
    if (mk_model_joints(r->model) == 1)
        return false;
    if (!(drives || r->balances) || !all_stand_still(r, q)) {
        memset(&r->rest, 0, sizeof r->rest);
        return false;
    }
    return is_regular(r, dt) && cannot_rest(r, t, dt, q);
}

enum mk_fault mk_residual_step(struct mk_residual *r, double t, double dt, const double *q,
                               const double *v, double u, int *joint)
{
    enum mk_fault fault = MK_FAULT_NONE;
    bool believed = r->limits->model_share < 1.0, driving = drives(r, dt);
    int motor = mk_plant(r->plant.plant)->motor_joint;
    smooth_speeds(r, dt, v);
    bool driven = believed && driven_by_another(r, &r->joint[motor], t, dt, q, v, motor);
    bool moved = believed && check_rest(r, t, dt, q, driving);
    for (int j = 0; j < mk_model_joints(r->model); j++) {
        enum mk_fault found = believed && driving ? check(r, t, dt, q, v, j) : skip(&r->joint[j]);
        if (fault == MK_FAULT_NONE && found != MK_FAULT_NONE) {
            fault = found;
            *joint = j + 1;
        }
        remember(r, &r->joint[j], dt, q[j]);
    }
    /* What jumps seems fast as well; and of all joints none is named. */
    if (fault == MK_FAULT_NONE && (driven || moved)) {
        fault = driven ? MK_FAULT_DRIVEN : MK_FAULT_STUCK;
        *joint = driven ? motor + 1 : 0;
    }
    r->u = u;
    return fault;
}

/* The rig: links, encoders, motor, cables. What the motor does is small and slow, and ends at once
 * when the rig does anything unexpected. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "console/doctor.h"

#define RATE_HZ 500.0
#define REST_S 0.5
#define REST_RAD 0.008
#define HAND_S 30.0
#define HAND_RAD 0.5
#define PUSH_SHARE 0.3 /* of u_max */
#define PUSH_S 0.06
#define PUSH_WATCH_S 0.12
#define SWEEP_RAD 0.4
#define SWEEP_S 8.0 /* there and back */
#define SERVO_RADPS 18.0
#define TOO_FAR_RAD 1.5
#define DRAG_SHARE 0.015 /* of u_max, beyond the model's friction: a cable drags */

/* A rig watched from outside: motions since the watch began. Those of a joint that slides are in
 * units of mk_model_joint_scale, so that the bounds above hold for them too. */
struct watch {
    struct mk_board *board;
    struct mk_clock *clock;
    int joints, bits;
    double count[MK_MAX_JOINTS]; /* its size */
    int32_t raw[MK_MAX_JOINTS];
    double q[MK_MAX_JOINTS];
    double u; /* applied */
    int64_t next_ns;
    bool primed;
};

static void watch_begin(struct watch *w, struct mk_board *board, const struct mk_model *model)
{
    struct mk_board_identity id = {.counter_bits = 24};
    *w = (struct watch){.board = board, .clock = board->clock, .joints = mk_model_joints(model)};
    (void)board->ops->identify(board, &id, NULL);
    w->bits = id.counter_bits;
    for (int j = 0; j < w->joints; j++)
        w->count[j] = mk_model_count(model, j) / mk_model_joint_scale(model, j);
    w->next_ns = mk_clock_now_ns(w->clock);
}

/* One sample under the command u. False: the board is of no more use. */
static bool watch_step(struct watch *w, double u)
{
    struct mk_board_sample s;
    w->next_ns += (int64_t)(1e9 / RATE_HZ);
    mk_clock_sleep_until(w->clock, w->next_ns);
    enum mk_status st = mk_board_exchange(w->board, u, &s);
    if (st == MK_ERR_TIMEOUT || st == MK_ERR_PROTO)
        return true;
    if (st != MK_OK || s.status & (MK_BOARD_ST_WATCHDOG | MK_BOARD_ST_FAULT))
        return false;
    for (int j = 0; j < w->joints; j++) {
        if (w->primed)
            w->q[j] += w->count[j] * mk_counter_difference(s.count[j], w->raw[j], w->bits);
        w->raw[j] = s.count[j];
    }
    w->u = s.u_applied;
    w->primed = true;
    return true;
}

static bool cancelled(const struct doctor *d)
{
    return d->cancel && *d->cancel;
}

static void motor_off(struct mk_board *board)
{
    (void)board->ops->safe_state(board);
    if (board->ops->set_watchdog)
        (void)board->ops->set_watchdog(board, 0, NULL);
}

/* --- rest --------------------------------------------------------------------------------------
 */

bool doctor_rest(struct doctor *d, struct mk_board *board, const struct mk_model *model)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    struct watch w;
    double low[MK_MAX_JOINTS] = {0}, high[MK_MAX_JOINTS] = {0};
    bool still = true;
    watch_begin(&w, board, model);
    for (int k = 0; k < (int)(REST_S * RATE_HZ); k++) {
        if (!watch_step(&w, 0.0)) {
            doctor_say(d, DOCTOR_PROBLEM, "links", "check cable and power",
                       "the board fell silent");
            return false;
        }
        for (int j = 0; j < w.joints; j++) {
            low[j] = fmin(low[j], w.q[j]);
            high[j] = fmax(high[j], w.q[j]);
        }
    }
    for (int j = 0; j < w.joints; j++) {
        if (plant->joint_is_wheel[j] || high[j] - low[j] <= REST_RAD)
            continue;
        still = false;
        doctor_say(d, DOCTOR_PROBLEM, "links", "let them hang straight down and come to rest",
                   "joint %d moves by %.3g %s with the motor off", j + 1,
                   (high[j] - low[j]) * mk_model_joint_scale(model, j),
                   mk_model_unit(model, j, "rad"));
    }
    if (still)
        doctor_say(d, DOCTOR_OK, "links", "", "hang still with the motor off");
    return still;
}

/* --- by hand ------------------------------------------------------------------------------------
 */

#define NOBODY (-1)
#define SILENCE (-2)

/* Watches until some joint has moved by HAND_RAD: its index, NOBODY, or SILENCE of the board. */
static int who_moves(struct doctor *d, struct watch *w, double *moved)
{
    double from[MK_MAX_JOINTS];
    memcpy(from, w->q, sizeof from);
    for (int k = 0; k < (int)(HAND_S * RATE_HZ) && !cancelled(d); k++) {
        if (!watch_step(w, 0.0))
            return SILENCE;
        for (int j = 0; j < w->joints; j++)
            if (fabs(w->q[j] - from[j]) > HAND_RAD) {
                *moved = w->q[j] - from[j];
                return j;
            }
    }
    return NOBODY;
}

static bool turn_by_hand(struct doctor *d, struct watch *w, const struct mk_model *model, int joint,
                         double sign)
{
    char request[120], what[32];
    double moved = 0.0;
    if (model->joint_linear[joint])
        snprintf(request, sizeof request, "push joint %d %s by %.3g m", joint + 1,
                 sign > 0 ? "the way that counts forwards" : "back",
                 HAND_RAD * mk_model_joint_scale(model, joint));
    else
        snprintf(request, sizeof request,
                 "hold the other link and turn joint %d %s by half a radian", joint + 1,
                 sign > 0 ? "anticlockwise" : "back clockwise");
    snprintf(what, sizeof what, "encoder %d", joint + 1);
    d->ask(d->user, request);
    int who = who_moves(d, w, &moved);
    if (cancelled(d))
        return false;
    if (who == SILENCE)
        doctor_say(d, DOCTOR_PROBLEM, what, "check cable and power", "the board fell silent");
    else if (who == NOBODY)
        doctor_say(d, DOCTOR_PROBLEM, what, "check its plug and cable, and its supply",
                   "no count within %.0f s", HAND_S);
    else if (who != joint)
        doctor_say(d, DOCTOR_PROBLEM, what, "exchange the two encoder plugs at the board",
                   "encoder %d counts instead: they are swapped", who + 1);
    else if (moved * sign < 0.0)
        doctor_say(d, DOCTOR_PROBLEM, what, "exchange its A and B wires",
                   "counts backwards: %+.3g %s", moved * mk_model_joint_scale(model, joint),
                   mk_model_unit(model, joint, "rad"));
    return who == joint && moved * sign > 0.0;
}

void doctor_by_hand(struct doctor *d, struct mk_board *board, const struct mk_model *model)
{
    struct watch w;
    watch_begin(&w, board, model);
    /* The outer joint first: it can be turned while the inner one is held. */
    for (int j = w.joints - 1; j >= 0 && !cancelled(d); j--) {
        char what[32];
        snprintf(what, sizeof what, "encoder %d", j + 1);
        if (turn_by_hand(d, &w, model, j, 1.0) && turn_by_hand(d, &w, model, j, -1.0))
            doctor_say(d, DOCTOR_OK, what, "", "counts both ways");
        w.next_ns = mk_clock_now_ns(w.clock);
    }
}

/* --- a push --------------------------------------------------------------------------------------
 */

/* Pushes one way and notes where the joints are a moment later. Short enough not to need limits,
 * which swapped encoders would make nonsense of. */
static bool push(struct mk_board *board, const struct mk_model *model, double u,
                 double moved[MK_MAX_JOINTS])
{
    struct watch w;
    watch_begin(&w, board, model);
    bool well = watch_step(&w, 0.0);
    for (int k = 0; k < (int)(PUSH_WATCH_S * RATE_HZ) && well; k++)
        well = watch_step(&w, k < (int)(PUSH_S * RATE_HZ) ? u : 0.0);
    memcpy(moved, w.q, sizeof w.q);
    return well;
}

/* What the model's own rig does under the same treatment. */
static struct mk_board *model_board(const struct mk_model *model, struct mk_clock *clock)
{
    struct mk_board *board = NULL;
    mk_clock_init_simulated(clock);
    const struct mk_board_config config = {.model = model, .clock = clock};
    if (mk_board_open(mk_board_backend_by_name("virtual"), &config, &board, NULL) != MK_OK)
        return NULL;
    return board;
}

/* How a rig would answer that is wired in another way. */
struct wiring {
    bool swapped;
    int sign[MK_MAX_JOINTS];
};

static void wire_up(const struct wiring *x, const double expected[MK_MAX_JOINTS], int joints,
                    double out[MK_MAX_JOINTS])
{
    for (int j = 0; j < joints; j++)
        out[j] = x->sign[j] * expected[x->swapped ? joints - 1 - j : j];
}

/* Relative distance of two answers, 0 .. 2. */
static double distance(const double *a, const double *b, int joints)
{
    double d = 0.0, scale = 0.0;
    for (int j = 0; j < joints; j++) {
        d += (a[j] - b[j]) * (a[j] - b[j]);
        scale += 0.5 * (a[j] * a[j] + b[j] * b[j]);
    }
    return scale > 0.0 ? sqrt(d / scale) : 0.0;
}

static struct wiring best_wiring(const double *moved, const double *expected, int joints,
                                 double *misfit)
{
    struct wiring best = {false, {1, 1}};
    *misfit = distance(moved, expected, joints);
    for (int k = 1; k < 8; k++) {
        struct wiring x = {k & 4, {k & 1 ? -1 : 1, k & 2 ? -1 : 1}};
        double out[MK_MAX_JOINTS] = {0};
        if (joints == 1 && k > 1)
            break;
        wire_up(&x, expected, joints, out);
        double m = distance(moved, out, joints);
        if (m < 0.7 * *misfit) { /* the plain explanation wins when it is nearly as good */
            best = x;
            *misfit = m;
        }
    }
    return best;
}

static void say_wiring(struct doctor *d, const struct mk_model *model, const struct wiring *x,
                       const double *moved, double misfit)
{
    int motor = mk_plant(model->plant)->motor_joint;
    double size = mk_model_joint_scale(model, motor);
    const char *unit = mk_model_unit(model, motor, "rad");
    if (misfit > 0.8)
        doctor_say(d, DOCTOR_PROBLEM, "motor and encoders",
                   "is this the model of this rig? encoders plugged in? power supply on?",
                   "a push moved the joints by %+.4f and %+.4f %s, as no wiring explains",
                   moved[0] * size, moved[1] * size, unit);
    else if (x->swapped)
        doctor_say(d, DOCTOR_PROBLEM, "motor and encoders",
                   "exchange the two encoder plugs at the board", "the encoders are swapped");
    else if (x->sign[0] < 0 && x->sign[1] < 0)
        doctor_say(d, DOCTOR_PROBLEM, "motor and encoders", "exchange the motor's two wires",
                   "the motor turns backwards");
    else if (x->sign[0] < 0 || x->sign[1] < 0)
        doctor_say(d, DOCTOR_PROBLEM, "motor and encoders",
                   "exchange the A and B wires of that encoder", "encoder %d counts backwards",
                   x->sign[0] < 0 ? 1 : 2);
    else
        doctor_say(d, DOCTOR_OK, "motor and encoders", "",
                   "a push moved joint %d by %+.4f %s, both ways, as the model has it", motor + 1,
                   moved[motor] * size, unit);
}

bool doctor_push(struct doctor *d, struct mk_board *board, const struct mk_model *model)
{
    struct mk_clock clock;
    struct mk_board *expect = model_board(model, &clock);
    int joints = mk_model_joints(model);
    double u = PUSH_SHARE * model->u_max;
    double ahead[2] = {0}, back[2] = {0}, moved[2] = {0}, expected[2] = {0};
    bool well = expect && push(expect, model, u, expected) && !cancelled(d);
    mk_board_close(expect);
    if (well && board->ops->set_watchdog)
        well = board->ops->set_watchdog(board, 20, NULL) == MK_OK;
    well = well && push(board, model, u, ahead);
    motor_off(board);
    mk_clock_sleep_until(board->clock, mk_clock_now_ns(board->clock) + INT64_C(3000000000));
    well = well && !cancelled(d);
    if (well && board->ops->set_watchdog)
        well = board->ops->set_watchdog(board, 20, NULL) == MK_OK;
    well = well && push(board, model, -u, back);
    motor_off(board);
    if (cancelled(d))
        return false;
    if (!well) {
        doctor_say(d, DOCTOR_PROBLEM, "motor and encoders", "check cable and power",
                   "the push was broken off: the board tripped");
        return false;
    }
    for (int j = 0; j < joints; j++)
        moved[j] = 0.5 * (ahead[j] - back[j]);
    double misfit;
    struct wiring x = best_wiring(moved, expected, joints, &misfit);
    if (joints == 1)
        x.sign[1] = x.sign[0];
    say_wiring(d, model, &x, moved, misfit);
    return misfit <= 0.8 && !x.swapped && x.sign[0] > 0 && x.sign[1] > 0;
}

/* --- a slow sweep --------------------------------------------------------------------------------
 */

static double triangle(double t)
{
    double phase = fmod(t / SWEEP_S, 1.0);
    if (phase < 0.25)
        return 4.0 * phase;
    return phase < 0.75 ? 2.0 - 4.0 * phase : 4.0 * phase - 4.0;
}

/* Leads the motor joint along a slow triangle by a PD servo; half the difference between the
 * commands of the two directions, over the middle of the way, is what drags. */
static bool sweep(struct doctor *d, struct mk_board *board, const struct mk_model *model,
                  double *drag)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    double mass[4], h[2], still[2] = {0};
    mk_plant_mass(model, plant->rest, still, mass, h);
    int motor = plant->motor_joint, n = (int)(1.5 * SWEEP_S * RATE_HZ);
    double inertia = mass[motor * plant->joints + motor];
    double kp = inertia * SERVO_RADPS * SERVO_RADPS, kd = 1.4 * inertia * SERVO_RADPS;
    double speed = 0.0, before = 0.0, sum[2] = {0.0, 0.0};
    int count[2] = {0, 0};
    struct watch w;
    watch_begin(&w, board, model);
    bool well = watch_step(&w, 0.0);
    for (int k = 0; k < n && well && !cancelled(d); k++) {
        double t = k / RATE_HZ, target = SWEEP_RAD * triangle(t);
        speed += 0.2 * ((w.q[motor] - before) * RATE_HZ - speed);
        before = w.q[motor];
        double u = kp * (target - w.q[motor]) - kd * speed;
        u = fmax(-0.8 * model->u_max, fmin(0.8 * model->u_max, u));
        well = watch_step(&w, u) && fabs(w.q[motor]) < TOO_FAR_RAD;
        /* One whole cycle, after the first quarter; near the ends friction changes its sign. */
        if (t < 0.5 * SWEEP_S || fabs(target) > 0.6 * SWEEP_RAD)
            continue;
        int way = triangle(t + 0.01) > triangle(t);
        sum[way] += w.u;
        count[way]++;
    }
    if (count[0] > 0 && count[1] > 0)
        *drag = 0.5 * (sum[1] / count[1] - sum[0] / count[0]);
    return well && !cancelled(d);
}

void doctor_sweep(struct doctor *d, struct mk_board *board, const struct mk_model *model)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    if (plant->joint_is_wheel[plant->motor_joint]) {
        doctor_say(d, DOCTOR_SKIPPED, "cable drag", "", "the motor turns a wheel: no cable on it");
        return;
    }
    struct mk_clock clock;
    struct mk_board *expect = model_board(model, &clock);
    double drag = 0.0, expected = 0.0;
    bool well = expect && sweep(d, expect, model, &expected);
    mk_board_close(expect);
    if (well && board->ops->set_watchdog)
        well = board->ops->set_watchdog(board, 20, NULL) == MK_OK;
    well = well && sweep(d, board, model, &drag);
    motor_off(board);
    double more = drag - expected;
    if (cancelled(d))
        return;
    if (!well)
        doctor_say(d, DOCTOR_PROBLEM, "cable drag", "check wiring and limits",
                   "the sweep was broken off");
    else if (more > DRAG_SHARE * model->u_max)
        doctor_say(d, DOCTOR_PROBLEM, "cable drag",
                   "free the cables, look at the bearing; or fit the friction: mechkit identify",
                   "friction of %.2f command units, %.2f more than the model's", drag, more);
    else
        doctor_say(d, DOCTOR_OK, "cable drag", "",
                   "friction of %.2f command units in a slow sweep, the model has %.2f", drag,
                   expected);
}

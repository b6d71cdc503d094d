/* The rig: links, encoders, motor, cables. What the motor does is small and slow, and ends at once
 * when the rig does anything unexpected. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "console/commands/doctor.h"
#include "investigate/nudge.h"

#define RATE_HZ RIG_WATCH_RATE_HZ
#define REST_S 0.5
#define REST_RAD 0.008
#define HAND_S 30.0
#define HAND_RAD 0.5
#define SWEEP_RAD 0.4
#define SWEEP_S 8.0 /* there and back */
#define SERVO_RADPS 18.0
#define SERVO_SHARE 0.5 /* of u_max at least, where the joint is the sweep's whole way off */
#define TOO_FAR_RAD 1.5
#define DRAG_SHARE 0.015 /* of u_max, beyond the model's friction: a cable drags */

static bool cancelled(const struct doctor *d)
{
    return d->cancel && *d->cancel;
}

/* --- rest --------------------------------------------------------------------------------------
 */

bool doctor_rest(struct doctor *d, struct mk_board *board, const struct mk_model *model)
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    struct rig_watch w;
    double low[MK_MAX_JOINTS] = {0}, high[MK_MAX_JOINTS] = {0};
    bool still = true;
    rig_watch_begin(&w, board, model);
    for (int k = 0; k < (int)(REST_S * RATE_HZ); k++) {
        if (!rig_watch_step(&w, 0.0)) {
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
static int who_moves(struct doctor *d, struct rig_watch *w, double *moved)
{
    double from[MK_MAX_JOINTS];
    memcpy(from, w->q, sizeof from);
    for (int k = 0; k < (int)(HAND_S * RATE_HZ) && !cancelled(d); k++) {
        if (!rig_watch_step(w, 0.0))
            return SILENCE;
        for (int j = 0; j < w->joints; j++)
            if (fabs(w->q[j] - from[j]) > HAND_RAD) {
                *moved = w->q[j] - from[j];
                return j;
            }
    }
    return NOBODY;
}

static bool turn_by_hand(struct doctor *d, struct rig_watch *w, const struct mk_model *model,
                         int joint, double sign)
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
    struct rig_watch w;
    rig_watch_begin(&w, board, model);
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

static void say_wiring(struct doctor *d, const struct mk_model *model, const struct rig_nudge *n)
{
    const double *moved = n->moved;
    const struct rig_wiring *x = &n->wiring;
    int motor = mk_plant(model->plant)->motor_joint;
    double size = mk_model_joint_scale(model, motor);
    const char *unit = mk_model_unit(model, motor, "rad");
    const double strength = moved[motor] / n->expected[motor];
    char ways[RIG_MOTION_TEXT];
    if (n->misfit > RIG_MISFIT)
        doctor_say(d, DOCTOR_PROBLEM, "motor and encoders",
                   "is this the model of this rig? encoders plugged in? power supply on?",
                   "a push moved the joints by %s, as no wiring explains",
                   rig_motion_text(model, moved, ways, sizeof ways));
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
    else if (strength < 0.5 || strength > 2.0)
        doctor_say(
            d, DOCTOR_OK, "motor and encoders", "",
            "wired as the model has it, but a push moved joint %d by %+.4f %s for the model's "
            "%+.4f: values are off, or the motor is weak",
            motor + 1, moved[motor] * size, unit, n->expected[motor] * size);
    else
        doctor_say(d, DOCTOR_OK, "motor and encoders", "",
                   "a push moved joint %d by %+.4f %s, both ways, as the model has it", motor + 1,
                   moved[motor] * size, unit);
}

bool doctor_push(struct doctor *d, struct mk_board *board, const struct mk_model *model)
{
    struct rig_nudge n;
    bool well = rig_nudge(board, model, d->cancel, &n);
    if (cancelled(d))
        return false;
    if (!well) {
        doctor_say(d, DOCTOR_PROBLEM, "motor and encoders", "check cable and power",
                   "the push was broken off: the board tripped");
        return false;
    }
    say_wiring(d, model, &n);
    return rig_nudge_is_well(&n);
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
    double inertia = mass[motor * (plant->joints + 1)] * mk_model_joint_scale(model, motor);
    double kp = fmax(inertia * SERVO_RADPS * SERVO_RADPS, SERVO_SHARE * model->u_max / SWEEP_RAD);
    double kd = 1.4 * sqrt(inertia * kp);
    double speed = 0.0, before = 0.0, sum[2] = {0.0, 0.0};
    int count[2] = {0, 0};
    struct rig_watch w;
    rig_watch_begin(&w, board, model);
    bool well = rig_watch_step(&w, 0.0);
    for (int k = 0; k < n && well && !cancelled(d); k++) {
        double t = k / RATE_HZ, target = SWEEP_RAD * triangle(t);
        speed += 0.2 * ((w.q[motor] - before) * RATE_HZ - speed);
        before = w.q[motor];
        double u = kp * (target - w.q[motor]) - kd * speed;
        u = fmax(-0.8 * model->u_max, fmin(0.8 * model->u_max, u));
        well = rig_watch_step(&w, u) && fabs(w.q[motor]) < TOO_FAR_RAD;
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
    struct mk_board *expect = rig_model_board(model, &clock);
    double drag = 0.0, expected = 0.0;
    bool well = expect && sweep(d, expect, model, &expected);
    mk_board_close(expect);
    if (well && board->ops->set_watchdog)
        well = board->ops->set_watchdog(board, 20, NULL) == MK_OK;
    well = well && sweep(d, board, model, &drag);
    rig_motor_off(board);
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

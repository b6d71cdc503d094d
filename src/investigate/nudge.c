#include "investigate/nudge.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define PUSH_S 0.06
#define PUSH_WATCH_S 0.12
#define PAUSE_NS INT64_C(3000000000)

void rig_watch_begin(struct rig_watch *w, struct mk_board *board, const struct mk_model *model)
{
    struct mk_board_identity id = {.counter_bits = 24};
    *w =
        (struct rig_watch){.board = board, .clock = board->clock, .joints = mk_model_joints(model)};
    (void)board->ops->identify(board, &id, NULL);
    w->bits = id.counter_bits;
    for (int j = 0; j < w->joints; j++)
        w->count[j] = mk_model_count(model, j) / mk_model_joint_scale(model, j);
    w->next_ns = mk_clock_now_ns(w->clock);
}

bool rig_watch_step(struct rig_watch *w, double u)
{
    struct mk_board_sample s;
    w->next_ns += (int64_t)(1e9 / RIG_WATCH_RATE_HZ);
    mk_clock_sleep_until(w->clock, w->next_ns);
    enum mk_status st = mk_board_exchange(w->board, u, &s);
    w->asked++;
    if (st == MK_ERR_TIMEOUT || st == MK_ERR_PROTO) {
        w->lost++;
        return true;
    }
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

void rig_motor_off(struct mk_board *board)
{
    (void)board->ops->safe_state(board);
    if (board->ops->set_watchdog)
        (void)board->ops->set_watchdog(board, 0, NULL);
}

/* Pushes one way and notes where the joints are a moment later. Short enough not to need limits,
 * which swapped encoders would make nonsense of. */
static bool push(struct mk_board *board, const struct mk_model *model, double u,
                 double moved[MK_MAX_JOINTS])
{
    struct rig_watch w;
    rig_watch_begin(&w, board, model);
    bool well = rig_watch_step(&w, 0.0);
    for (int k = 0; k < (int)(PUSH_WATCH_S * RIG_WATCH_RATE_HZ) && well; k++)
        well = rig_watch_step(&w, k < (int)(PUSH_S * RIG_WATCH_RATE_HZ) ? u : 0.0);
    memcpy(moved, w.q, sizeof w.q);
    return well;
}

struct mk_board *rig_model_board(const struct mk_model *model, struct mk_clock *clock)
{
    struct mk_board *board = NULL;
    mk_clock_init_simulated(clock);
    const struct mk_board_config config = {.model = model, .clock = clock};
    if (mk_board_open(mk_board_backend_by_name("virtual"), &config, &board, NULL) != MK_OK)
        return NULL;
    return board;
}

static void wire_up(const struct rig_wiring *x, const double expected[MK_MAX_JOINTS], int joints,
                    double out[MK_MAX_JOINTS])
{
    for (int j = 0; j < joints; j++)
        out[j] = x->sign[j] * expected[x->swapped ? joints - 1 - j : j];
}

/* Relative distance of an answer a from an expected one b, 0 .. 2, whatever the motor's strength:
 * min over s of |a - s b| / sqrt((|a|^2 + |s b|^2) / 2). How strong a motor is, wiring does not
 * say: a weak one is what an investigation is to find. One that hardly moves its rig is dead. */
static double distance(const double *a, const double *b, int joints)
{
    const double weakest = 0.05, strongest = 20.0; /* of what the model says */
    double ab = 0.0, aa = 0.0, bb = 0.0;
    for (int j = 0; j < joints; j++) {
        ab += a[j] * b[j];
        aa += a[j] * a[j];
        bb += b[j] * b[j];
    }
    if (aa + bb <= 0.0)
        return 0.0;
    const double s = bb > 0.0 ? fmin(fmax(ab / bb, weakest), strongest) : 1.0;
    return sqrt(fmax(aa - 2.0 * s * ab + s * s * bb, 0.0) / (0.5 * (aa + s * s * bb)));
}

static struct rig_wiring best_wiring(const double *moved, const double *expected, int joints,
                                     double *misfit)
{
    struct rig_wiring best = {false, {1, 1}};
    *misfit = distance(moved, expected, joints);
    for (int k = 1; k < 8; k++) {
        struct rig_wiring x = {k & 4, {k & 1 ? -1 : 1, k & 2 ? -1 : 1}};
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

static bool guarded_push(struct mk_board *board, const struct mk_model *model, double u,
                         double moved[MK_MAX_JOINTS])
{
    bool well = !board->ops->set_watchdog || board->ops->set_watchdog(board, 20, NULL) == MK_OK;
    well = well && push(board, model, u, moved);
    rig_motor_off(board);
    return well;
}

bool rig_nudge(struct mk_board *board, const struct mk_model *model, const volatile int *cancel,
               struct rig_nudge *out)
{
    struct mk_clock clock;
    struct mk_board *expect = rig_model_board(model, &clock);
    const int joints = mk_model_joints(model);
    const double u = RIG_PUSH_SHARE * model->u_max;
    double ahead[MK_MAX_JOINTS] = {0}, back[MK_MAX_JOINTS] = {0};
    *out = (struct rig_nudge){.misfit = 2.0};
    bool well = expect && push(expect, model, u, out->expected) && !(cancel && *cancel);
    mk_board_close(expect);
    well = well && guarded_push(board, model, u, ahead);
    if (!well)
        return false;
    mk_clock_sleep_until(board->clock, mk_clock_now_ns(board->clock) + PAUSE_NS);
    if ((cancel && *cancel) || !guarded_push(board, model, -u, back))
        return false;
    for (int j = 0; j < joints; j++)
        out->moved[j] = 0.5 * (ahead[j] - back[j]);
    out->wiring = best_wiring(out->moved, out->expected, joints, &out->misfit);
    if (joints == 1)
        out->wiring.sign[1] = out->wiring.sign[0];
    return true;
}

bool rig_nudge_is_well(const struct rig_nudge *n)
{
    return n->misfit <= RIG_MISFIT && !n->wiring.swapped && n->wiring.sign[0] > 0 &&
           n->wiring.sign[1] > 0;
}

const char *rig_motion_text(const struct mk_model *model, const double moved[MK_MAX_JOINTS],
                            char *buf, size_t size)
{
    size_t used = 0;
    for (int j = 0; j < mk_model_joints(model) && used < size; j++)
        used += (size_t)snprintf(buf + used, size - used, "%s%+.4f %s", j ? " and " : "",
                                 moved[j] * mk_model_joint_scale(model, j),
                                 mk_model_unit(model, j, "rad"));
    return buf;
}

/* The virtual board: the simulated rig behind exactly the interface that hardware has.
 *
 * It lives on the run's clock. The plant is integrated up to "now" whenever somebody looks, so the
 * same code serves real time, where calls come with jitter, and simulated time, where they come
 * exactly on the sample. When nobody looks for longer than the watchdog allows, the plant goes on
 * from the moment of the time-out with a command of 0, as the electronics would have done it.
 *
 * The fault script counts samples from the last set_watchdog, which the loop calls when a run
 * begins: sample n of the script is tick n of the log.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/random.h"
#include "driver/backends.h"
#include "driver/fault_script.h"
#include "mechkit/rig.h"

#define PIECE_NS 100000000 /* longest time handed to the solver at once */

struct virtual_board {
    struct mk_rig *rig;
    struct mk_fault_script script;
    struct mk_random random; /* of the script's noise */
    int joints;

    int64_t opened_ns; /* the board's clock starts here */
    int64_t plant_ns;  /* how far the plant has been integrated */
    double u;          /* command in force */

    int64_t watchdog_ns; /* 0: off */
    int64_t fed_ns;      /* last exchange that arrived, or when the watchdog was set */
    bool fired;

    uint32_t sequence;
    uint64_t sample; /* of the script */
    bool script_runs;
    bool gone;
    bool was_stuck[MK_MAX_JOINTS];
    int32_t held[MK_MAX_JOINTS];   /* reading of a stuck counter */
    int32_t offset[MK_MAX_JOINTS]; /* counts that slipped */
};

static enum mk_status virtual_open(struct mk_board *board, const struct mk_board_config *config,
                                   struct mk_error *err)
{
    struct virtual_board *v = board->priv;
    v->joints = mk_model_joints(config->model);
    enum mk_status st = mk_fault_script_read(config->fault_script, v->joints, &v->script, err);
    if (st != MK_OK)
        return st;

    struct mk_rig_config rig;
    mk_rig_config_default(&rig);
    rig.seed = config->seed;
    rig.count_noise = config->count_noise;
    memcpy(rig.start, config->start, sizeof rig.start);
    st = mk_rig_create(config->model, &rig, &v->rig, err);
    if (st != MK_OK)
        return st;
    v->random.state = ~config->seed;
    v->opened_ns = v->plant_ns = mk_clock_now_ns(board->clock);
    return MK_OK;
}

static enum mk_status virtual_identify(struct mk_board *board, struct mk_board_identity *out,
                                       struct mk_error *err)
{
    struct virtual_board *v = board->priv;
    if (v->gone)
        return mk_error_set(err, MK_ERR_NODEV, "the virtual board has been unplugged");
    *out = (struct mk_board_identity){.counter_bits = MK_COUNTER_BITS};
    snprintf(out->name, sizeof out->name, "virtual");
    snprintf(out->firmware, sizeof out->firmware, "mechkit %s", MK_VERSION);
    for (int j = 0; j < v->joints; j++)
        out->encoder_cpr[j] = mk_rig_model(v->rig)->encoder_cpr[j];
    return MK_OK;
}

static enum mk_status run_plant(struct virtual_board *v, int64_t to_ns)
{
    /* In pieces: a solver gives up after so many steps, and nobody may have looked for an hour. */
    while (v->plant_ns < to_ns) {
        int64_t left_ns = to_ns - v->plant_ns;
        int64_t piece_ns = left_ns < PIECE_NS ? left_ns : PIECE_NS;
        if (mk_rig_advance(v->rig, (double)piece_ns * 1e-9, v->u, NULL) != MK_OK)
            return MK_ERR_NUMERIC;
        v->plant_ns += piece_ns;
    }
    return MK_OK;
}

/* Brings the plant to now; the watchdog may have bitten on the way. RT. */
static enum mk_status catch_up(struct mk_board *board, int64_t now_ns)
{
    struct virtual_board *v = board->priv;
    int64_t bite_ns = v->fed_ns + v->watchdog_ns;
    if (v->watchdog_ns > 0 && !v->fired && now_ns > bite_ns) {
        enum mk_status st = run_plant(v, bite_ns);
        v->fired = true;
        v->u = 0.0;
        if (st != MK_OK)
            return st;
    }
    return run_plant(v, now_ns);
}

/* What the counters show: the rig's, and what the script does to them. */
static void read_counters(struct virtual_board *v, const struct mk_fault_effects *fx,
                          int32_t count[MK_MAX_JOINTS])
{
    mk_rig_counts(v->rig, count);
    for (int j = 0; j < v->joints; j++) {
        int32_t jitter = 0;
        if (fx->noise_counts > 0.0)
            jitter = (int32_t)lround(fx->noise_counts * mk_random_normal(&v->random));
        v->offset[j] = mk_counter_difference(v->offset[j] + fx->slip[j], 0, MK_COUNTER_BITS);
        /* Wraps like the counter itself. */
        count[j] = mk_counter_difference(count[j] + v->offset[j] + jitter, 0, MK_COUNTER_BITS);
        if (fx->stuck[j] && v->was_stuck[j])
            count[j] = v->held[j];
        v->was_stuck[j] = fx->stuck[j];
        v->held[j] = count[j];
    }
}

/* Takes over a command: the watchdog and the script's weak amplifier stand between. */
static void apply_command(struct virtual_board *v, double u, const struct mk_fault_effects *fx)
{
    double allowed = fmax(-fx->u_limit, fmin(fx->u_limit, u));
    v->u = v->fired ? 0.0 : allowed;
}

static enum mk_status virtual_exchange(struct mk_board *board, double u,
                                       struct mk_board_sample *out)
{
    struct virtual_board *v = board->priv;
    if (v->gone)
        return MK_ERR_NODEV;
    struct mk_fault_effects fx = {.u_limit = INFINITY};
    if (v->script_runs)
        mk_fault_script_at(&v->script, v->sample++, &fx);
    if (fx.disconnect) {
        /* The plug is out: what the board does from here on shows in the plant only. */
        v->gone = true;
        return MK_ERR_NODEV;
    }

    int64_t now_ns = mk_clock_now_ns(board->clock);
    enum mk_status st = catch_up(board, now_ns);
    if (st != MK_OK)
        return st;
    int32_t count[MK_MAX_JOINTS];
    read_counters(v, &fx, count);
    if (fx.drop)
        return MK_ERR_TIMEOUT;

    apply_command(v, u, &fx);
    v->fed_ns = now_ns;
    uint32_t sequence = v->sequence++;
    if (fx.delay_s > 0.0)
        mk_clock_sleep_until(board->clock, now_ns + (int64_t)(fx.delay_s * 1e9));
    if (fx.mute)
        return MK_ERR_TIMEOUT;

    *out = (struct mk_board_sample){
        .board_ns = now_ns - v->opened_ns, .sequence = sequence, .u_applied = v->u};
    memcpy(out->count, count, sizeof out->count);
    out->status = (v->fired ? MK_BOARD_ST_WATCHDOG : 0u) |
                  (v->u != u ? MK_BOARD_ST_SATURATED : 0u) | (fx.alarm ? MK_BOARD_ST_FAULT : 0u);
    return MK_OK;
}

static enum mk_status virtual_zero_counters(struct mk_board *board, struct mk_error *err)
{
    struct virtual_board *v = board->priv;
    if (v->gone)
        return mk_error_set(err, MK_ERR_NODEV, "the virtual board has been unplugged");
    enum mk_status st = catch_up(board, mk_clock_now_ns(board->clock));
    if (st != MK_OK)
        return mk_error_set(err, st, "the simulation of the rig failed");
    mk_rig_zero(v->rig);
    memset(v->offset, 0, sizeof v->offset);
    memset(v->held, 0, sizeof v->held);
    return MK_OK;
}

static enum mk_status virtual_safe_state(struct mk_board *board)
{
    struct virtual_board *v = board->priv;
    /* An unplugged board hears nothing; its watchdog does this instead. */
    if (v->gone)
        return MK_ERR_NODEV;
    enum mk_status st = catch_up(board, mk_clock_now_ns(board->clock));
    v->u = 0.0;
    return st;
}

static enum mk_status virtual_set_watchdog(struct mk_board *board, unsigned timeout_ms,
                                           struct mk_error *err)
{
    struct virtual_board *v = board->priv;
    if (v->gone)
        return mk_error_set(err, MK_ERR_NODEV, "the virtual board has been unplugged");
    int64_t now_ns = mk_clock_now_ns(board->clock);
    enum mk_status st = catch_up(board, now_ns);
    if (st != MK_OK)
        return mk_error_set(err, st, "the simulation of the rig failed");
    v->watchdog_ns = (int64_t)timeout_ms * 1000000;
    v->fed_ns = now_ns;
    v->fired = false;
    v->sample = 0;
    v->script_runs = true;
    return MK_OK;
}

static void virtual_close(struct mk_board *board)
{
    struct virtual_board *v = board->priv;
    mk_rig_destroy(v->rig);
    v->rig = NULL;
}

struct mk_rig *mk_board_virtual_rig(struct mk_board *board)
{
    if (board->ops != &mk_board_virtual_ops)
        return NULL;
    struct virtual_board *v = board->priv;
    /* An unplugged board still has its rig, and the rig goes on. */
    (void)catch_up(board, mk_clock_now_ns(board->clock));
    return v->rig;
}

const struct mk_board_ops mk_board_virtual_ops = {
    .name = "virtual",
    .help = "the simulated rig, in real or simulated time",
    .capabilities =
        MK_BOARD_CAP_WATCHDOG | MK_BOARD_CAP_TIMESTAMP | MK_BOARD_CAP_SIMULATED | MK_BOARD_CAP_FAST,
    .private_size = sizeof(struct virtual_board),
    .open = virtual_open,
    .identify = virtual_identify,
    .zero_counters = virtual_zero_counters,
    .exchange = virtual_exchange,
    .safe_state = virtual_safe_state,
    .set_watchdog = virtual_set_watchdog,
    .close = virtual_close,
};

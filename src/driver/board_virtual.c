/* The virtual board: the emulated one at the end of a wire that is a function call.
 *
 * It lives on the run's clock. Everything between the board interface and the rig is what a USB or
 * parallel-port board has as well: messages, their checks, the board's own code.
 *
 * The fault script counts exchanges from the last set_watchdog, which the loop calls when a run
 * begins: sample n of the script is tick n of the log until the loop skips one. The board is told
 * neither the loop's period nor its deadlines, so it cannot see that.
 */
#include <math.h>
#include <string.h>

#include "driver/backends.h"
#include "driver/emulated.h"
#include "driver/wire.h"

struct virtual_board {
    struct mk_wire wire; /* first: the slots of wire.h find it there */
    struct mk_emulated emulated;
    struct mk_fault_script script;
    uint64_t sample; /* of the script: exchanges so far */
    bool script_runs;
    bool mute;      /* the answer to come gets lost */
    bool unplugged; /* for good */
    int64_t delay_ns;
    uint8_t received[MK_FRAME_MAX];
};

/* --- the wire ----------------------------------------------------------------------------------
 */

static enum mk_status virtual_send(void *link, const uint8_t *bytes, size_t n, int64_t deadline_ns)
{
    struct virtual_board *v = link;
    (void)deadline_ns;
    if (v->unplugged)
        return MK_ERR_NODEV;
    return mk_emulated_receive(&v->emulated, bytes, n);
}

/* Nothing has been said: what comes next is a streamed sample, at its time. */
static void await_sample(struct mk_emulated *e)
{
    if (e->sent_size > 0 || !e->device.stream_us)
        return;
    mk_clock_sleep_until(e->clock, e->opened_ns + (int64_t)e->device.stream_next_ns);
    (void)mk_emulated_run(e);
}

static enum mk_status virtual_receive(void *link, const uint8_t **bytes, size_t *n,
                                      int64_t deadline_ns)
{
    struct virtual_board *v = link;
    struct mk_clock *clock = v->emulated.clock;
    if (deadline_ns > 0) /* 0: what is there already */
        await_sample(&v->emulated);
    if (v->delay_ns > 0)
        mk_clock_sleep_until(clock, mk_clock_now_ns(clock) + v->delay_ns);
    v->delay_ns = 0;
    *bytes = v->received;
    *n = mk_emulated_take(&v->emulated, v->received, sizeof v->received);
    return *n > 0 && !v->mute ? MK_OK : MK_ERR_TIMEOUT;
}

static const struct mk_link_ops virtual_link = {virtual_send, virtual_receive};

/* --- the board ---------------------------------------------------------------------------------
 */

static enum mk_status virtual_open(struct mk_board *board, const struct mk_board_config *config,
                                   struct mk_error *err)
{
    struct virtual_board *v = board->priv;
    enum mk_status st =
        mk_fault_script_read(config->fault_script, mk_model_joints(config->model), &v->script, err);
    if (st == MK_OK)
        st = mk_emulated_init(&v->emulated, config, "virtual", "", err);
    if (st != MK_OK)
        return st;
    st = mk_wire_open(&v->wire, &virtual_link, v, err);
    if (st != MK_OK)
        mk_emulated_free(&v->emulated);
    return st;
}

static enum mk_status virtual_exchange(struct mk_board *board, double u,
                                       struct mk_board_sample *out)
{
    struct virtual_board *v = board->priv;
    struct mk_fault_effects *fx = &v->emulated.effects;
    if (v->script_runs)
        mk_fault_script_at(&v->script, v->sample++, fx);
    if (fx->disconnect) {
        /* The plug is out: what the board does from here on shows in the plant only. */
        v->wire.gone = v->unplugged = true;
        return MK_ERR_NODEV;
    }
    if (fx->drop) {
        int32_t count[MK_MAX_JOINTS];
        enum mk_status st = mk_emulated_run(&v->emulated);
        mk_emulated_counters(&v->emulated, count); /* they go on, though nobody gets to see them */
        return st == MK_OK ? MK_ERR_TIMEOUT : st;
    }
    v->mute = fx->mute;
    v->delay_ns = fx->delay_s > 0.0 ? (int64_t)(fx->delay_s * 1e9) : 0;
    enum mk_status st = mk_wire_board_exchange(board, u, out);
    v->mute = false;
    return st;
}

static enum mk_status virtual_set_watchdog(struct mk_board *board, unsigned timeout_ms,
                                           struct mk_error *err)
{
    struct virtual_board *v = board->priv;
    v->emulated.effects = (struct mk_fault_effects){.u_limit = INFINITY};
    v->sample = 0;
    v->script_runs = true;
    return mk_wire_board_watchdog(board, timeout_ms, err);
}

static void virtual_close(struct mk_board *board)
{
    struct virtual_board *v = board->priv;
    mk_emulated_free(&v->emulated);
}

struct mk_rig *mk_board_virtual_rig(struct mk_board *board)
{
    if (board->ops != &mk_board_virtual_ops)
        return NULL;
    struct virtual_board *v = board->priv;
    /* An unplugged board still has its rig, and the rig goes on. */
    (void)mk_emulated_run(&v->emulated);
    return v->emulated.rig;
}

const struct mk_board_ops mk_board_virtual_ops = {
    .name = "virtual",
    .help = "the simulated rig, in real or simulated time",
    .capabilities =
        MK_BOARD_CAP_WATCHDOG | MK_BOARD_CAP_TIMESTAMP | MK_BOARD_CAP_SIMULATED | MK_BOARD_CAP_FAST,
    .private_size = sizeof(struct virtual_board),
    .open = virtual_open,
    .identify = mk_wire_board_identify,
    .zero_counters = mk_wire_board_zero,
    .exchange = virtual_exchange,
    .stream = mk_wire_board_stream,
    .safe_state = mk_wire_board_safe,
    .set_watchdog = virtual_set_watchdog,
    .close = virtual_close,
};

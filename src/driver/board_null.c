/* The null board: no rig, no motor, links that hang still. It shows the least a back end must do,
 * and tests of the loop use it where a plant would only be in the way. */
#include <stdio.h>

#include "driver/backends.h"

struct null_board {
    double u;
    uint32_t sequence;
};

static enum mk_status null_open(struct mk_board *board, const struct mk_board_config *config,
                                struct mk_error *err)
{
    (void)board;
    (void)config;
    (void)err;
    return MK_OK;
}

static enum mk_status null_identify(struct mk_board *board, struct mk_board_identity *out,
                                    struct mk_error *err)
{
    (void)board;
    (void)err;
    *out = (struct mk_board_identity){.counter_bits = 24};
    snprintf(out->name, sizeof out->name, "null");
    snprintf(out->firmware, sizeof out->firmware, "mechkit %s", MK_VERSION);
    return MK_OK;
}

static enum mk_status null_zero_counters(struct mk_board *board, struct mk_error *err)
{
    (void)board;
    (void)err;
    return MK_OK;
}

static enum mk_status null_exchange(struct mk_board *board, double u, struct mk_board_sample *out)
{
    struct null_board *n = board->priv;
    n->u = u;
    *out = (struct mk_board_sample){
        .board_ns = mk_clock_now_ns(board->clock), .sequence = n->sequence++, .u_applied = u};
    return MK_OK;
}

static enum mk_status null_safe_state(struct mk_board *board)
{
    struct null_board *n = board->priv;
    n->u = 0.0;
    return MK_OK;
}

static void null_close(struct mk_board *board)
{
    (void)board;
}

const struct mk_board_ops mk_board_null_ops = {
    .name = "null",
    .help = "no rig at all: links that hang still, commands that go nowhere",
    .capabilities = MK_BOARD_CAP_SIMULATED | MK_BOARD_CAP_FAST | MK_BOARD_CAP_NO_RIG,
    .private_size = sizeof(struct null_board),
    .open = null_open,
    .identify = null_identify,
    .zero_counters = null_zero_counters,
    .exchange = null_exchange,
    .safe_state = null_safe_state,
    .close = null_close,
};

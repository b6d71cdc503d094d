/* Opening and closing boards: the part that is the same for every back end. */
#include <stdalign.h>
#include <stddef.h>
#include <stdlib.h>

#include "mechkit/board.h"

/* The handle and the back end's private data share one block. */
#define PRIVATE_OFFSET                                                                             \
    ((sizeof(struct mk_board) + alignof(max_align_t) - 1) / alignof(max_align_t) *                 \
     alignof(max_align_t))

static enum mk_status check_config(const struct mk_board_ops *ops,
                                   const struct mk_board_config *config, struct mk_error *err)
{
    if (!ops || !config || !config->model || !config->clock)
        return mk_error_set(err, MK_ERR_INVALID, "a board needs a back end, a model and a clock");
    if (!(config->model->u_max > 0.0))
        return mk_error_set(err, MK_ERR_INVALID, "the model's u_max must be positive, not %g",
                            config->model->u_max);
    const bool has_others = ops->find || (ops->capabilities & MK_BOARD_CAP_ADDRESSED);
    if (config->device && !has_others)
        return mk_error_set(err, MK_ERR_INVALID,
                            "there is one board %s: leave out --device, or choose another --board",
                            ops->name);
    if (config->clock->ops->simulated && !mk_board_may_be_fast(ops))
        return mk_error_set(err, MK_ERR_NOTSUP, "board %s runs in real time only", ops->name);
    return MK_OK;
}

enum mk_status mk_board_open(const struct mk_board_ops *ops, const struct mk_board_config *config,
                             struct mk_board **out, struct mk_error *err)
{
    *out = NULL;
    enum mk_status st = check_config(ops, config, err);
    if (st != MK_OK)
        return st;
    char *block = calloc(1, PRIVATE_OFFSET + ops->private_size);
    if (!block)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for board %s", ops->name);
    struct mk_board *board = (struct mk_board *)(void *)block;
    board->ops = ops;
    board->u_max = config->model->u_max;
    board->clock = config->clock;
    board->priv = block + PRIVATE_OFFSET;

    st = ops->open(board, config, err);
    if (st != MK_OK) {
        free(block);
        return st;
    }
    if (config->clock->ops->simulated && !(ops->capabilities & MK_BOARD_CAP_FAST))
        st = ops->follow(board, err);
    if (st != MK_OK) {
        mk_board_close(board);
        return st;
    }
    *out = board;
    return MK_OK;
}

void mk_board_close(struct mk_board *board)
{
    if (!board)
        return;
    (void)board->ops->safe_state(board);
    board->ops->close(board);
    free(board);
}

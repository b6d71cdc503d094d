#include "emu/bench.h"

#include <string.h>

#include "suites.h"

void emu_bench_init(struct emu_bench *b, const char *back_end, const struct mk_board_config *config)
{
    struct mk_error err = MK_ERROR_INIT;
    memset(b, 0, sizeof *b);
    b->ops = *mk_board_backend_by_name(back_end);
    b->ops.capabilities |= MK_BOARD_CAP_FAST;
    if (strcmp(back_end, "usb") != 0)
        return;
    enum mk_status st = mk_emulated_init(&b->board, config, "emulated", "MK-0001", &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    emu_usb_init(&b->usb, 1, "MK-0001", emu_board_of(&b->board));
    b->usb.timed = &b->board;
    emu_usb_plug(&b->usb);
}

void emu_bench_free(struct emu_bench *b)
{
    if (!b->board.rig)
        return;
    emu_usb_free(&b->usb);
    mk_emulated_free(&b->board);
}

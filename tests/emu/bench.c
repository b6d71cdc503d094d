#include "emu/bench.h"

#include <string.h>

#include "suites.h"

void emu_bench_init(struct emu_bench *b, const char *back_end, const struct mk_board_config *config)
{
    struct mk_error err = MK_ERROR_INIT;
    memset(b, 0, sizeof *b);
    bool usb = strcmp(back_end, "usb") == 0, pp = strncmp(back_end, "parport", 7) == 0;
    b->ops = *mk_board_backend_by_name(pp ? "parport" : back_end);
    b->ops.capabilities |= MK_BOARD_CAP_FAST;
    if (!usb && !pp)
        return;
    enum mk_status st = mk_emulated_init(&b->board, config, "emulated", "MK-0001", &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    if (usb) {
        emu_usb_init(&b->usb, 1, "MK-0001", emu_board_of(&b->board));
        b->line = &b->usb.line;
        b->usb.timed = &b->board;
        emu_usb_plug(&b->usb);
    } else {
        unsigned modes = strstr(back_end, "nibble") ? EMU_PP_NIBBLE
                         : strstr(back_end, "byte") ? EMU_PP_BYTE | EMU_PP_NIBBLE
                                                    : EMU_PP_EPP | EMU_PP_BYTE | EMU_PP_NIBBLE;
        emu_pp_init(&b->pp, 0, modes, emu_board_of(&b->board));
        b->line = &b->pp.line;
        b->pp.timed = &b->board;
    }
}

void emu_bench_plug(struct emu_bench *b)
{
    if (b->line == &b->usb.line)
        emu_usb_plug(&b->usb);
    else
        b->pp.unplugged = false;
}

void emu_bench_unplug(struct emu_bench *b)
{
    if (b->line == &b->usb.line)
        emu_usb_unplug(&b->usb);
    else
        b->pp.unplugged = true;
}

void emu_bench_free(struct emu_bench *b)
{
    if (!b->board.rig)
        return;
    if (b->line == &b->usb.line)
        emu_usb_free(&b->usb);
    else
        emu_pp_free(&b->pp);
    mk_emulated_free(&b->board);
}

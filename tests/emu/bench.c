#include "emu/bench.h"

#include <stdio.h>
#include <string.h>

#include "suites.h"

static void sit_at_usb(struct emu_bench *b)
{
    emu_usb_init(&b->usb, 1, "MK-0001", emu_board_of(&b->board));
    b->line = &b->usb.line;
    b->usb.timed = &b->board;
    emu_usb_plug(&b->usb);
}

static void sit_at_parport(struct emu_bench *b, const char *back_end)
{
    unsigned modes = strstr(back_end, "nibble") ? EMU_PP_NIBBLE
                     : strstr(back_end, "byte") ? EMU_PP_BYTE | EMU_PP_NIBBLE
                                                : EMU_PP_EPP | EMU_PP_BYTE | EMU_PP_NIBBLE;
    emu_pp_init(&b->pp, 0, modes, emu_board_of(&b->board));
    b->line = &b->pp.line;
    b->pp.timed = &b->board;
}

static void sit_at_stream(struct emu_bench *b, const char *back_end)
{
    emu_stream_init(&b->stream, strncmp(back_end, "tcp", 3) == 0 ? EMU_TCP : EMU_PTY,
                    emu_board_of(&b->board));
    b->line = &b->stream.line;
    b->stream.timed = b->stepped ? NULL : &b->board;
    b->stream.cut = strstr(back_end, "cut") ? 12 : 0;
    b->device = b->stream.device;
}

void emu_bench_init(struct emu_bench *b, const char *back_end, const struct mk_board_config *config)
{
    struct mk_error err = MK_ERROR_INIT;
    char name[32] = "";
    memset(b, 0, sizeof *b);
    sscanf(back_end, "%31[^-]", name);
    b->ops = *mk_board_backend_by_name(name);
    b->stepped = strstr(back_end, "stepped") != NULL;
    if (!b->stepped)
        b->ops.capabilities |= MK_BOARD_CAP_FAST;
    if (strcmp(name, "virtual") == 0 || strcmp(name, "null") == 0)
        return;
    struct mk_board_config own = *config;
    mk_step_clock_init(&b->clock);
    if (b->stepped)
        own.clock = &b->clock.clock;
    enum mk_status st = mk_emulated_init(&b->board, &own, "emulated", "MK-0001", &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    if (b->stepped)
        mk_emulated_allow_steps(&b->board, &b->clock);
    if (strcmp(name, "usb") == 0)
        sit_at_usb(b);
    else if (strcmp(name, "parport") == 0)
        sit_at_parport(b, back_end);
    else
        sit_at_stream(b, back_end);
}

void emu_bench_plug(struct emu_bench *b)
{
    if (b->line == &b->usb.line)
        emu_usb_plug(&b->usb);
    else if (b->line == &b->stream.line)
        emu_stream_plug(&b->stream);
    else
        b->pp.unplugged = false;
}

void emu_bench_unplug(struct emu_bench *b)
{
    if (b->line == &b->usb.line)
        emu_usb_unplug(&b->usb);
    else if (b->line == &b->stream.line)
        emu_stream_unplug(&b->stream);
    else
        b->pp.unplugged = true;
}

void emu_bench_free(struct emu_bench *b)
{
    if (!b->board.rig)
        return;
    if (b->line == &b->usb.line)
        emu_usb_free(&b->usb);
    else if (b->line == &b->stream.line)
        emu_stream_free(&b->stream);
    else
        emu_pp_free(&b->pp);
    mk_emulated_free(&b->board);
}

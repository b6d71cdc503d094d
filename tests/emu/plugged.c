/* Linked into `mechkit-emulated`: the program itself, with an emulated board at USB and at the
 * parallel port before it begins. The rig is that of the model named by MECHKIT_EMULATED_MODEL
 * (default: the pendubot). */
#include <stdio.h>
#include <stdlib.h>

#include "emu/pp.h"
#include "emu/usb.h"

static struct mk_emulated board;
static struct emu_usb usb_port;
static struct emu_pp pp_port;
static struct mk_clock clock_;

__attribute__((constructor)) static void plug_in(void)
{
    struct mk_model model;
    struct mk_error err = MK_ERROR_INIT;
    const char *path = getenv("MECHKIT_EMULATED_MODEL");
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    mk_clock_init_monotonic(&clock_);
    const struct mk_board_config config = {.model = &model, .clock = &clock_};
    if ((path && mk_model_read(path, &model, &err) != MK_OK) ||
        mk_emulated_init(&board, &config, "emulated", "MK-0001", &err) != MK_OK) {
        fprintf(stderr, "no emulated board: %s\n", err.message);
        exit(1);
    }
    /* One board on two plugs: whoever opens one of them has it. */
    emu_usb_init(&usb_port, 1, "MK-0001", emu_board_of(&board));
    usb_port.timed = &board;
    emu_usb_plug(&usb_port);
    emu_pp_init(&pp_port, 0, EMU_PP_EPP | EMU_PP_BYTE | EMU_PP_NIBBLE, emu_board_of(&board));
    pp_port.timed = &board;
}

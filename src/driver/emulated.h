/* A board that is not there, for the virtual back end and for stand-ins of buses in tests: the
 * board's own code (device.h) with a simulated rig where the electronics would be. Bytes in, bytes
 * out; time is that of the clock it is given.
 *
 * The plant is integrated up to "now" whenever somebody looks, and what the board would have done
 * in between (watchdog, streamed samples, stand-alone control) is done at its time: so the same
 * code serves real time, where calls come with jitter, and simulated time, where they come exactly
 * on the sample. One thread at a time; nothing is allocated after creation.
 */
#ifndef MECHKIT_DRIVER_EMULATED_H
#define MECHKIT_DRIVER_EMULATED_H

#include "base/random.h"
#include "driver/device.h"
#include "driver/fault_script.h"
#include "driver/step_clock.h"
#include "mechkit/board.h"
#include "mechkit/rig.h"

struct mk_emulated {
    struct mk_device device;
    struct mk_device_hal hal;
    struct mk_device_info info;
    struct mk_rig *rig;
    struct mk_clock *clock;
    struct mk_random random;
    int joints;
    int64_t opened_ns; /* the board's clock starts here */
    int64_t plant_ns;  /* how far the plant has been integrated */
    double u;          /* command in force */
    bool failed;       /* the simulation has */
    uint64_t seed;
    struct mk_step_clock *steps; /* the clock, where a host may step it */

    struct mk_fault_effects effects; /* in force now: set by whoever plays a script */
    bool was_stuck[MK_MAX_JOINTS];
    int32_t held[MK_MAX_JOINTS];   /* reading of a stuck counter */
    int32_t offset[MK_MAX_JOINTS]; /* counts that slipped */

    char lcd[MK_LCD_ROWS][MK_LCD_COLUMNS + 1];
    uint8_t leds, switches;

    uint8_t sent[8 * MK_FRAME_MAX]; /* by the board, not taken yet */
    size_t sent_size;
};

MK_NODISCARD enum mk_status mk_emulated_init(struct mk_emulated *e,
                                             const struct mk_board_config *config,
                                             const char *product, const char *serial,
                                             struct mk_error *err);
void mk_emulated_free(struct mk_emulated *e);
/* As after a loss of power: counters stand anywhere, nothing is remembered; the rig goes on. */
void mk_emulated_restart(struct mk_emulated *e);
/* The rig back at its start, the same noise again; the board goes on. Allocates. */
void mk_emulated_begin_anew(struct mk_emulated *e);
/* A host may step the board's clock, which must be the one of the configuration. When it begins to,
 * and when it ends, the rig is put back to its start: a run in steps is repeatable, whatever was
 * before it. That allocates, so such a board is not for the real-time path of a host. */
void mk_emulated_allow_steps(struct mk_emulated *e, struct mk_step_clock *clock);
/* Brings plant and board to now. MK_ERR_NUMERIC. RT. */
enum mk_status mk_emulated_run(struct mk_emulated *e);
/* Bytes reach the board now. RT. */
enum mk_status mk_emulated_receive(struct mk_emulated *e, const uint8_t *bytes, size_t n);
/* Takes up to `size` bytes of what the board has sent. RT. */
size_t mk_emulated_take(struct mk_emulated *e, uint8_t *bytes, size_t size);
/* The counters as the board reads them. RT. */
void mk_emulated_counters(struct mk_emulated *e, int32_t count[MK_MAX_JOINTS]);

#endif

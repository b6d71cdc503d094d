#include "driver/emulated.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define PIECE_NS 100000000 /* longest time handed to the solver at once */

/* --- the electronics ---------------------------------------------------------------------------
 */

static uint64_t hal_now(void *user)
{
    struct mk_emulated *e = user;
    return (uint64_t)(e->plant_ns - e->opened_ns);
}

/* What the counters show: the rig's, and what faults do to them. */
void mk_emulated_counters(struct mk_emulated *e, int32_t count[MK_MAX_JOINTS])
{
    struct mk_fault_effects *fx = &e->effects;
    mk_rig_counts(e->rig, count);
    for (int j = 0; j < e->joints; j++) {
        int32_t jitter = 0;
        if (fx->noise_counts > 0.0)
            jitter = (int32_t)lround(fx->noise_counts * mk_random_normal(&e->random));
        e->offset[j] = mk_counter_difference(e->offset[j] + fx->slip[j], 0, MK_COUNTER_BITS);
        fx->slip[j] = 0;
        /* Wraps like the counter itself. */
        count[j] = mk_counter_difference(count[j] + e->offset[j] + jitter, 0, MK_COUNTER_BITS);
        if (fx->stuck[j] && e->was_stuck[j])
            count[j] = e->held[j];
        e->was_stuck[j] = fx->stuck[j];
        e->held[j] = count[j];
    }
}

static void hal_read_counters(void *user, int32_t count[MK_WIRE_JOINTS])
{
    mk_emulated_counters(user, count);
}

static void hal_zero_counters(void *user)
{
    struct mk_emulated *e = user;
    mk_rig_zero(e->rig);
    memset(e->offset, 0, sizeof e->offset);
    memset(e->held, 0, sizeof e->held);
}

static int32_t hal_apply(void *user, int32_t micro)
{
    struct mk_emulated *e = user;
    double limit = e->effects.u_limit, u = (double)micro / MK_WIRE_MICRO;
    e->u = fmax(-limit, fmin(limit, u));
    return e->u == u ? micro : (int32_t)lround(e->u * MK_WIRE_MICRO);
}

static void hal_send(void *user, const uint8_t *bytes, size_t n)
{
    struct mk_emulated *e = user;
    if (n > sizeof e->sent - e->sent_size)
        return; /* nobody has taken the others in time */
    memcpy(e->sent + e->sent_size, bytes, n);
    e->sent_size += n;
}

static uint16_t hal_alarm(void *user)
{
    struct mk_emulated *e = user;
    return e->effects.alarm ? MK_WIRE_FAULT_AMPLIFIER : 0;
}

static void hal_lcd(void *user, unsigned row, const char text[MK_LCD_COLUMNS + 1])
{
    struct mk_emulated *e = user;
    memcpy(e->lcd[row], text, MK_LCD_COLUMNS + 1);
}

static void hal_leds(void *user, uint8_t mask)
{
    struct mk_emulated *e = user;
    e->leds = mask;
}

static uint8_t hal_switches(void *user)
{
    struct mk_emulated *e = user;
    return e->switches;
}

/* --- a clock that the host steps ----------------------------------------------------------------
 */

void mk_emulated_begin_anew(struct mk_emulated *e)
{
    e->failed = mk_rig_restart(e->rig, NULL) != MK_OK;
    e->random.state = ~e->seed;
    memset(e->offset, 0, sizeof e->offset);
    memset(e->was_stuck, 0, sizeof e->was_stuck);
}

static void hold(struct mk_emulated *e, bool held)
{
    mk_step_clock_hold(e->steps, held);
    e->plant_ns = mk_clock_now_ns(e->clock);
    mk_emulated_begin_anew(e);
}

static void hal_step(void *user, uint64_t ns)
{
    struct mk_emulated *e = user;
    if (!e->steps->held)
        hold(e, true);
    mk_clock_sleep_until(e->clock, e->opened_ns + (int64_t)ns);
    (void)mk_emulated_run(e);
}

static void hal_run_freely(void *user)
{
    hold(user, false);
}

void mk_emulated_allow_steps(struct mk_emulated *e, struct mk_step_clock *clock)
{
    e->steps = clock;
    e->hal.step = hal_step;
    e->hal.run_freely = hal_run_freely;
}

/* --- life --------------------------------------------------------------------------------------
 */

static void describe(struct mk_emulated *e, const struct mk_model *model, const char *product,
                     const char *serial)
{
    struct mk_device_info *info = &e->info;
    *info = (struct mk_device_info){.encoders = (uint8_t)e->joints,
                                    .counter_bits = MK_COUNTER_BITS,
                                    .u_max_micro = (int32_t)lround(model->u_max * MK_WIRE_MICRO)};
    snprintf(info->product, sizeof info->product, "%s", product);
    snprintf(info->firmware, sizeof info->firmware, "mechkit %s", MK_VERSION);
    snprintf(info->serial, sizeof info->serial, "%s", serial);
    for (int j = 0; j < e->joints; j++)
        info->cpr[j] = model->encoder_cpr[j];
}

enum mk_status mk_emulated_init(struct mk_emulated *e, const struct mk_board_config *config,
                                const char *product, const char *serial, struct mk_error *err)
{
    const struct mk_model *model = config->model;
    memset(e, 0, sizeof *e);
    if (model->u_max > MK_WIRE_U_MAX)
        return mk_error_set(err, MK_ERR_RANGE,
                            "a u_max of %g is beyond what the protocol carries, %d", model->u_max,
                            MK_WIRE_U_MAX);
    struct mk_rig_config rig;
    mk_rig_config_default(&rig);
    rig.seed = config->seed;
    rig.count_noise = config->count_noise;
    memcpy(rig.start, config->start, sizeof rig.start);
    enum mk_status st = mk_rig_create(model, &rig, &e->rig, err);
    if (st != MK_OK)
        return st;
    e->joints = mk_model_joints(model);
    e->clock = config->clock;
    e->seed = config->seed;
    e->random.state = ~config->seed;
    e->effects.u_limit = INFINITY;
    e->opened_ns = e->plant_ns = mk_clock_now_ns(e->clock);
    e->hal = (struct mk_device_hal){.user = e,
                                    .now_ns = hal_now,
                                    .read_counters = hal_read_counters,
                                    .zero_counters = hal_zero_counters,
                                    .apply = hal_apply,
                                    .send = hal_send,
                                    .alarm = hal_alarm,
                                    .lcd = hal_lcd,
                                    .leds = hal_leds,
                                    .switches = hal_switches};
    describe(e, model, product, serial);
    mk_device_init(&e->device, &e->hal, &e->info);
    return MK_OK;
}

void mk_emulated_free(struct mk_emulated *e)
{
    mk_rig_destroy(e->rig);
    e->rig = NULL;
}

void mk_emulated_restart(struct mk_emulated *e)
{
    (void)mk_emulated_run(e);
    mk_device_init(&e->device, &e->hal, &e->info);
    e->opened_ns = e->plant_ns;
    e->sent_size = 0;
}

/* --- time --------------------------------------------------------------------------------------
 */

static void run_plant(struct mk_emulated *e, int64_t to_ns)
{
    /* In pieces: a solver gives up after so many steps, and nobody may have looked for an hour. */
    while (e->plant_ns < to_ns && !e->failed) {
        int64_t left_ns = to_ns - e->plant_ns;
        int64_t piece_ns = left_ns < PIECE_NS ? left_ns : PIECE_NS;
        e->failed = mk_rig_advance(e->rig, (double)piece_ns * 1e-9, e->u, NULL) != MK_OK;
        e->plant_ns += piece_ns;
    }
}

enum mk_status mk_emulated_run(struct mk_emulated *e)
{
    int64_t now_ns = mk_clock_now_ns(e->clock);
    for (;;) {
        uint64_t event = mk_device_next_event(&e->device);
        if (event >= (uint64_t)(now_ns - e->opened_ns) || e->failed)
            break;
        run_plant(e, e->opened_ns + (int64_t)event);
        mk_device_poll(&e->device);
    }
    run_plant(e, now_ns);
    mk_device_poll(&e->device);
    return e->failed ? MK_ERR_NUMERIC : MK_OK;
}

enum mk_status mk_emulated_receive(struct mk_emulated *e, const uint8_t *bytes, size_t n)
{
    enum mk_status st = mk_emulated_run(e);
    if (st == MK_OK)
        mk_device_receive(&e->device, bytes, n);
    return st;
}

size_t mk_emulated_take(struct mk_emulated *e, uint8_t *bytes, size_t size)
{
    size_t n = e->sent_size < size ? e->sent_size : size;
    memcpy(bytes, e->sent, n);
    memmove(e->sent, e->sent + n, e->sent_size - n);
    e->sent_size -= n;
    return n;
}

/* mechkit standalone: the board's own controller, from setup to the uploaded arrays. */
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "console/commands/doctor.h"
#include "console/commands/options.h"
#include "console/commands/signals.h"
#include "ctrl/ctrl_rig.h"
#include "driver/standalone.h"
#include "driver/wire.h"
#include "mechkit/log.h"
#include "mechkit/loop.h"
#include "mechkit/number.h"
#include "mechkit/sim.h"

#define GUARD_MS 200      /* the board stops when the host falls silent for so long */
#define GUARD_NS 20000000 /* between two looks */

/* Setups that the board has a law for. */
static const struct setup {
    const char *name;
    enum mk_controller controller;
} setups[] = {
    {"pendubot-mid", MK_CONTROLLER_PENDUBOT_MID},
    {"pendubot-top", MK_CONTROLLER_PENDUBOT_TOP},
    {"reaction-wheel", MK_CONTROLLER_REACTION_WHEEL},
    {"furuta", MK_CONTROLLER_FURUTA},
    {"pi-speed", MK_CONTROLLER_PI_SPEED},
};
#define SETUPS (sizeof setups / sizeof setups[0])

#define EVERY_MOST 255 /* samples a record: one byte of the protocol */

struct gains {
    float value[MK_STANDALONE_GAINS];
    int count;
};

struct options {
    const struct setup *setup;
    const char *board, *device, *model, *out;
    struct gains gains;
    double seconds, rate_hz;
    int every; /* 0: found out */
    bool fast;
};

static volatile sig_atomic_t interrupted;

static void on_signal(int number)
{
    (void)number;
    interrupted = 1;
}

/* --- options -----------------------------------------------------------------------------------
 */

#define TEXT_OF_(x) #x
#define TEXT_OF(x) TEXT_OF_(x)

static bool take_gains(const char *value, void *target)
{
    struct gains *gains = target;
    double x[MK_STANDALONE_GAINS];
    bool fits = true;
    gains->count = option_numbers(value, x, MK_STANDALONE_GAINS);
    for (int i = 0; i < gains->count; i++) {
        gains->value[i] = (float)x[i];
        fits = fits && isfinite(gains->value[i]);
    }
    return fits && gains->count > 0;
}

static const struct option_row option_rows[] = {
    {"board", OPTION_TEXT(board), "NAME", "usb, parport, tcp, serial, virtual (default)"},
    {"device", OPTION_TEXT(device), "NAME",
     "which board, when there are several; with tcp HOST:PORT"},
    {"model", OPTION_TEXT(model), "M.ini",
     "the rig; default: the rig of the setup with Meesters' parameters"},
    {"gains", OPTION_CALL(gains), "LIST",
     "the first gains of the setup (docs/protocol.md); default: the board's", .take = take_gains,
     .wants = "1 to " TEXT_OF(MK_STANDALONE_GAINS) " finite numbers"},
    {"seconds", OPTION_NUMBER(seconds), "S", "how long; default 10", 0.01, 3600},
    {"rate", OPTION_NUMBER(rate_hz), "HZ", "samples per second; default 500", MK_LOOP_RATE_MIN_HZ,
     MK_LOOP_RATE_MAX_HZ},
    {"every", OPTION_COUNT(every), "N", "samples a record; default: so that the arrays last", 1,
     EVERY_MOST},
    {"out", OPTION_OUTPUT(out), "LOG.csv", "where the recorded arrays go; default: standalone.csv"},
    {"fast", OPTION_FLAG(fast), NULL,
     "in simulated time: the virtual board, or one that says it is simulated"},
    {0}};

static int run(int argc, char **argv);

const struct subcommand sub_standalone = {
    .name = "standalone",
    .summary = "let the board's own controller run, and fetch what it recorded",
    .synopsis = "SETUP [options]",
    .about =
        "The board controls the rig by itself, as the original kit did: the setup and its gains "
        "go\n"
        "down, it starts, halts, and the recorded arrays come up as a log. The links must hang\n"
        "still. Setups: pendubot-mid, pendubot-top, reaction-wheel, furuta, pi-speed.",
    .options = option_rows,
    .argument = "setup",
    .argument_is_name = true,
    .least = 1,
    .most = 1,
    .run = run,
};

static int find_setup(const char *name, struct options *o)
{
    for (size_t i = 0; i < SETUPS; i++)
        if (strcmp(setups[i].name, name) == 0)
            o->setup = &setups[i];
    return o->setup ? EXIT_OK : report_usage("standalone", "the board has no setup '%s'", name);
}

/* --- the run -----------------------------------------------------------------------------------
 */

/* The board says how many gains its setup has. */
static enum mk_status send_gains(struct mk_wire *w, const struct gains *gains, int count,
                                 struct mk_error *err)
{
    if (gains->count > count)
        return mk_error_set(err, MK_ERR_RANGE, "--gains: %d numbers, and the setup has %d gains",
                            gains->count, count);
    return gains->count > 0 ? mk_wire_gains(w, 0, gains->value, gains->count, err) : MK_OK;
}

/* So that the arrays last for the whole run, where nobody says otherwise. */
static unsigned record_every(const struct options *o)
{
    double lasting = ceil(o->seconds * o->rate_hz / (MK_STANDALONE_RECORDS - 1));
    return o->every > 0 ? (unsigned)o->every : (unsigned)lasting;
}

/* A log that ends before its run would be found out an hour too late. */
static int check_length(const struct options *o)
{
    const double most_s = (double)EVERY_MOST * (MK_STANDALONE_RECORDS - 1) / o->rate_hz;
    if (record_every(o) <= EVERY_MOST)
        return EXIT_OK;
    return report_usage("standalone",
                        "the board's arrays last for %.0f s at %g Hz, not for %g s: fewer "
                        "--seconds or a lower --rate; --every %d records the first %.0f s of them",
                        floor(most_s), o->rate_hz, o->seconds, EVERY_MOST, floor(most_s));
}

static enum mk_status prepare(struct mk_board *board, struct mk_wire *w, const struct options *o,
                              struct mk_error *err)
{
    int gains = 0;
    enum mk_status st = board->ops->set_watchdog(board, GUARD_MS, err);
    if (st == MK_OK)
        st = board->ops->zero_counters(board, err);
    if (st == MK_OK)
        st = mk_wire_setup(w, (int)o->setup->controller, (uint32_t)lround(1e6 / o->rate_hz),
                           record_every(o), &gains, err);
    return st == MK_OK ? send_gains(w, &o->gains, gains, err) : st;
}

/* Looks after the run; the board stops by itself when nobody does. MK_ERR_INTR: a signal ended it.
 */
static enum mk_status guard(struct mk_board *board, struct mk_wire *w, double seconds,
                            struct mk_error *err)
{
    int64_t end_ns = mk_clock_now_ns(board->clock) + (int64_t)(seconds * 1e9);
    while (mk_clock_now_ns(board->clock) < end_ns && !interrupted) {
        struct mk_wire_state s;
        enum mk_status st = mk_wire_state(w, &s, err);
        if (st != MK_OK)
            return st;
        if (s.fault)
            return mk_error_set(err, MK_ERR_FAULT, "the board stopped %.2f s ago: %s",
                                1e-9 * (double)(s.now_ns - s.fault_ns),
                                mk_wire_fault_text(s.fault));
        int64_t next_ns = mk_clock_now_ns(board->clock) + GUARD_NS;
        mk_clock_sleep_until(board->clock, next_ns < end_ns ? next_ns : end_ns);
    }
    return interrupted ? MK_ERR_INTR : MK_OK;
}

/* --- the arrays --------------------------------------------------------------------------------
 */

static enum mk_status describe(struct mk_log *log, const struct mk_wire *w,
                               const struct mk_model *model, const struct options *o)
{
    char text[128];
    enum mk_status st = mk_log_set_meta(log, "rig", mk_plant(model->plant)->name);
    snprintf(text, sizeof text, "%g", o->rate_hz / record_every(o));
    if (st == MK_OK)
        st = mk_log_set_meta(log, "sample_rate_hz", text);
    if (st == MK_OK)
        st = mk_record_describe_joints(log, model, true);
    snprintf(text, sizeof text, "%.9g", model->u_to_torque);
    if (st == MK_OK)
        st = mk_log_set_meta(log, "u_to_torque", text);
    snprintf(text, sizeof text, "%s, stand-alone", o->setup->name);
    if (st == MK_OK)
        st = mk_log_set_meta(log, "setup", text);
    snprintf(text, sizeof text, "%s, %s, serial %s", w->identity.name, w->identity.firmware,
             w->identity.serial[0] ? w->identity.serial : "-");
    return st == MK_OK ? mk_log_set_meta(log, "board", text) : st;
}

/* Counters wrap; from one record to the next nothing turns half their range. */
static void unwrap(struct mk_standalone_record *r, uint32_t n, int bits)
{
    int32_t before[MK_WIRE_JOINTS] = {0}, raw;
    for (uint32_t k = 0; k < n; k++)
        for (int j = 0; j < MK_WIRE_JOINTS; j++) {
            raw = r[k].count[j];
            if (k > 0)
                r[k].count[j] = r[k - 1].count[j] + mk_counter_difference(raw, before[j], bits);
            before[j] = raw;
        }
}

static void fill(struct mk_log *log, const struct mk_standalone_record *r, const struct mk_model *m,
                 double rate_hz)
{
    const struct mk_plant_info *plant = mk_plant(m->plant);
    static const char *const q[] = {"q1", "q2"}, *const enc[] = {"enc1", "enc2"};
    double *t = mk_log_add_column(log, "t"), *column;
    for (size_t k = 0; k < log->rows && t; k++)
        t[k] = r[k].sample / rate_hz;
    for (int j = 0; j < plant->joints; j++) {
        column = mk_log_add_column(log, q[j]);
        for (size_t k = 0; k < log->rows && column; k++)
            column[k] = plant->rest[j] + r[k].count[j] * mk_model_count(m, j);
    }
    column = mk_log_add_column(log, "u");
    for (size_t k = 0; k < log->rows && column; k++)
        column[k] = (double)r[k].micro / MK_WIRE_MICRO;
    for (int j = 0; j < plant->joints; j++) {
        column = mk_log_add_column(log, enc[j]);
        for (size_t k = 0; k < log->rows && column; k++)
            column[k] = r[k].count[j];
    }
    column = mk_log_add_column(log, "phase");
    for (size_t k = 0; k < log->rows && column; k++)
        column[k] = r[k].phase;
}

static enum mk_status fetch(struct mk_wire *w, const struct mk_model *model,
                            const struct options *o, struct mk_error *err)
{
    struct mk_standalone_record *r = calloc(MK_STANDALONE_RECORDS, sizeof *r);
    struct mk_log *log = NULL;
    int got = 1;
    uint32_t n = 0;
    enum mk_status st = r ? MK_OK : mk_error_set(err, MK_ERR_NOMEM, "no memory for the arrays");
    while (st == MK_OK && got > 0 && n < MK_STANDALONE_RECORDS) {
        st = mk_wire_upload(w, n, r + n, (int)(MK_STANDALONE_RECORDS - n), &got, err);
        n += st == MK_OK ? (uint32_t)got : 0;
    }
    if (st == MK_OK && (st = mk_log_create(n, &log)) != MK_OK)
        mk_error_set(err, st, "no memory for the log");
    if (st == MK_OK) {
        unwrap(r, n, w->identity.counter_bits);
        fill(log, r, model, o->rate_hz);
        st = describe(log, w, model, o);
        if (st == MK_OK)
            st = mk_log_write(o->out, log, err);
    }
    if (st == MK_OK)
        printf("%u records are in %s, the last in phase %s\n", n, show_name(o->out),
               mk_phase_name(n > 0 ? (enum mk_phase)r[n - 1].phase : MK_PHASE_IDLE));
    mk_log_free(log);
    free(r);
    return st;
}

/* --- all of it ---------------------------------------------------------------------------------
 */

static void quiet_line(void *user, enum doctor_verdict verdict, const char *what, const char *found,
                       const char *advice)
{
    if (verdict == DOCTOR_PROBLEM)
        mk_error_set(user, MK_ERR_FAULT, "%s: %s: %s", what, found, advice);
}

static enum mk_status run_board(struct mk_board *board, const struct mk_model *model,
                                const struct options *o, struct mk_error *err)
{
    struct mk_wire *w = mk_wire_of(board);
    struct doctor d = {.line = quiet_line, .user = err};
    if (!w || !(w->capabilities & MK_WIRE_CAP_STANDALONE))
        return mk_error_set(err, MK_ERR_NOTSUP, "board %s has no controllers of its own",
                            board->ops->name);
    if (!doctor_rest(&d, board, model))
        return err->status;
    enum mk_status st = prepare(board, w, o, err);
    if (st == MK_OK)
        st = mk_wire_start(w, err);
    if (st != MK_OK)
        return st;
    enum mk_status ran = guard(board, w, o->seconds, err);
    struct mk_error late = MK_ERROR_INIT;
    st = mk_wire_halt(w, &late);
    /* What was recorded is worth having whatever ended the run. */
    if (st == MK_OK)
        st = fetch(w, model, o, &late);
    const bool halted = ran == MK_OK || ran == MK_ERR_INTR;
    if (halted && st != MK_OK)
        *err = late;
    else if (ran == MK_ERR_INTR)
        mk_error_set(err, MK_ERR_INTR,
                     "interrupted; the motor is off, and what was recorded until then is in %s",
                     o->out);
    return halted && st != MK_OK ? st : ran;
}

static int run(int argc, char **argv)
{
    struct options o = {
        .board = "virtual", .out = "standalone.csv", .seconds = 10.0, .rate_hz = 500.0};
    struct mk_error err = MK_ERROR_INIT;
    struct mk_model model;
    struct mk_clock clock;
    struct mk_board *board;
    struct arguments setup;
    int code = options_parse(&sub_standalone, argc, argv, &o, &setup);
    if (code == EXIT_OK)
        code = find_setup(setup.text[0], &o);
    if (code != EXIT_OK)
        return code;
    o.rate_hz = 1e6 / round(1e6 / o.rate_hz); /* the board's clock makes whole microseconds */
    code = check_length(&o);
    if (code != EXIT_OK)
        return code;
    const struct mk_board_ops *ops = mk_board_backend_by_name(o.board);
    if (!ops)
        return report_usage("standalone",
                            "--board %s: there is no such board; `mechkit boards` lists them",
                            o.board);
    mk_model_default(mk_ctrl_first_rig(mk_ctrl_setup_by_name(o.setup->name)), &model);
    if (o.model && mk_model_read(o.model, &model, &err) != MK_OK)
        return report_error(&err);
    if (o.fast)
        mk_clock_init_simulated(&clock);
    else
        mk_clock_init_monotonic(&clock);
    signals_catch(on_signal);
    const struct mk_board_config config = {
        .model = &model, .clock = &clock, .seed = 1, .device = o.device};
    enum mk_status st = mk_board_open(ops, &config, &board, &err);
    if (st == MK_OK) {
        st = run_board(board, &model, &o, &err);
        mk_board_close(board);
    }
    if (st != MK_OK)
        report_error(&err);
    return st == MK_OK ? EXIT_OK : EXIT_RUN_FAILED;
}

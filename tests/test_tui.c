/* The screen without a terminal: what is drawn, what keys do, what the pictures show. */
#include "suites.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "console/commands/poles.h"
#include "console/screen/tui.h"
#include "experiment/linear.h"
#include "mechkit/design.h"
#include "support/files.h"

/* --- a session that is none ------------------------------------------------------------------ */

static struct tui *tui;
static struct host_status status;
static char posted[1000]; /* everything, a line each */
static int halts, stops;

static void on_post(void *user, const char *line)
{
    (void)user;
    size_t used = strlen(posted);
    snprintf(posted + used, sizeof posted - used, "%s\n", line);
}

static void on_halt(void *user)
{
    (void)user;
    halts++;
}

static void on_stop(void *user)
{
    (void)user;
    stops++;
}

static void choose(const char *setup, enum mk_plant_kind plant)
{
    static const double values[] = {80, 8, 100, 13};
    status.setup = mk_ctrl_setup_by_name(setup);
    mk_model_default(plant, &status.model);
    status.nominal = status.model;
    mk_loop_config_default(&status.model, &status.config);
    int gain = 0;
    for (int i = 0; i < status.setup->param_count; i++) {
        const struct mk_ctrl_param *p = &status.setup->param[i];
        status.initial[i] = status.value[i] = isnan(p->initial) ? values[gain++ % 4] : p->initial;
    }
}

static void begin(void)
{
    const struct tui_door door = {NULL, on_post, on_halt, on_stop, on_halt};
    setenv("TZ", "UTC", 1);
    tui = malloc(sizeof *tui);
    ck_assert_int_eq(tui_init(tui, &door), MK_OK);
    tui->canvas.unicode = true;
    memset(&status, 0, sizeof status);
    status.backend = mk_board_backend_by_name("virtual");
    status.progress = -1.0;
    status.disk_free_mb = 50000.0;
    posted[0] = '\0';
    halts = stops = 0;
}

static void end(void)
{
    tui_free(tui);
    free(tui);
}

static void news(void)
{
    tui_set_status(tui, &status);
}

static void press(const char *keys)
{
    for (; *keys; keys++)
        tui_key(tui, *keys == '\n' ? TK_RETURN : (unsigned char)*keys);
}

static void event(enum host_event_kind kind, const char *text)
{
    struct host_event e = {.when = 1000000000, .kind = kind};
    snprintf(e.text, sizeof e.text, "%s", text);
    tui_add_event(tui, &e);
}

/* A swing-up and a catch, drawn by a few sines. */
static struct mk_sample sample_at(int k)
{
    double t = k / 500.0, s = t < 2.0 ? t / 2.0 : exp(-(t - 2.0) * 3.0);
    struct mk_sample out = {.tick = (uint64_t)k, .t = t, .ref = (double)NAN, .late_us = 12.5};
    out.q[0] = -1.5707963 + 0.6 * s * sin(7.0 * t);
    out.q[1] = t < 2.0 ? 1.5 * t * sin(5.0 * t) : 3.1415926 - 0.3 * s * cos(9.0 * t);
    out.v[0] = 3.0 * s * cos(7.0 * t);
    out.v[1] = 4.0 * s * cos(5.0 * t);
    out.u = fmax(-10.0, fmin(10.0, 14.0 * s * sin(7.0 * t + 1.0)));
    out.phase = t < 2.0 ? MK_PHASE_SWINGUP : MK_PHASE_BALANCE;
    return out;
}

static void run_for(double seconds)
{
    choose("pendubot-mid", MK_PLANT_PENDUBOT);
    news();
    status.have_loop = status.running = true;
    status.snap.state = MK_LOOP_RUNNING;
    news();
    for (int k = 0; k < seconds * 500.0; k++) {
        struct mk_sample s = sample_at(k);
        tui_add_sample(tui, &s);
        status.snap.sample = s;
    }
    status.stats = (struct mk_loop_stats){
        .realtime = true, .late_p99_us = 41.2, .late_max_us = 133.0, .ticks = 2000};
    news();
}

/* --- pictures -------------------------------------------------------------------------------- */

static char *text_of(const struct canvas *c)
{
    char *text = malloc((size_t)c->rows * ((size_t)c->cols * 4 + 1) + 1), *out = text;
    for (int i = 0; i < c->rows; i++) {
        char *last = out;
        for (int j = 0; j < c->cols; j++) {
            out += tui_encode(c->cell[i * c->cols + j].ch, out);
            if (c->cell[i * c->cols + j].ch != ' ')
                last = out;
        }
        out = last;
        *out++ = '\n';
    }
    *out = '\0';
    return text;
}

static bool drawn(int rows, int cols, const char *text)
{
    tui_draw(tui, rows, cols);
    char *screen = text_of(&tui->canvas);
    bool found = strstr(screen, text) != NULL;
    free(screen);
    return found;
}

/* Compares with tests/golden/NAME.txt; MECHKIT_GOLDEN=write makes them anew. */
static void golden(const char *name, int rows, int cols)
{
    char path[600];
    snprintf(path, sizeof path, "%s/tests/golden/%s.txt", MK_SOURCE_DIR, name);
    tui_draw(tui, rows, cols);
    char *screen = text_of(&tui->canvas), *wanted = slurp_file(path);
    const char *write = getenv("MECHKIT_GOLDEN");
    if (write && strcmp(write, "write") == 0) {
        FILE *f = fopen(path, "w");
        fputs(screen, f);
        fclose(f);
    } else {
        ck_assert_msg(wanted && strcmp(wanted, screen) == 0, "%s is not what was agreed, but\n%s",
                      name, screen);
    }
    free(wanted);
    free(screen);
}

START_TEST(without_a_setup_it_says_how_to_begin)
{
    news();
    golden("begin", 24, 80);
    press("s");
    golden("setup", 24, 80);
}
END_TEST

/* On the smallest screen the list of setups has no room for all of them. */
START_TEST(the_chosen_setup_is_in_sight_on_the_smallest_screen)
{
    news();
    press("s");
    for (int i = 0; mk_ctrl_setup(i); i++) {
        char line[40];
        snprintf(line, sizeof line, "> %d  %s", i + 1, mk_ctrl_setup(i)->name);
        ck_assert_msg(drawn(TUI_MIN_ROWS, TUI_MIN_COLS, line), "%s", line);
        ck_assert(drawn(TUI_MIN_ROWS, TUI_MIN_COLS, "Enter takes it"));
        ck_assert(drawn(TUI_MIN_ROWS, TUI_MIN_COLS, "E-STOP"));
        ck_assert(drawn(TUI_MIN_ROWS, TUI_MIN_COLS, "\u2518 ")); /* the frame is whole */
        press("j");
    }
}
END_TEST

START_TEST(limits_of_a_joint_that_slides_are_shown_in_metres)
{
    struct mk_error err = MK_ERROR_INIT;
    choose("pi-speed", MK_PLANT_INERTIA_WHEEL);
    ck_assert_int_eq(mk_model_set_linear(&status.model, 0, true, &err), MK_OK);
    mk_safety_default(&status.model, 0.002, &status.config.limits);
    status.looked = status.still = true;
    status.q[0] = 0.25;
    news();
    ck_assert(drawn(24, 80, "q1 free, speed 9 m/s"));
    ck_assert(drawn(24, 80, "0.2500 m "));
    ck_assert(!drawn(24, 80, "rad"));
}
END_TEST

START_TEST(before_a_start_the_check_list_says_what_is_well)
{
    choose("pendubot-mid", MK_PLANT_PENDUBOT);
    status.looked = status.still = true;
    status.q[0] = -M_PI / 2;
    event(HOST_COMMAND, "setup pendubot-mid");
    event(HOST_SAYS, "setup pendubot-mid on the pendubot, board virtual");
    news();
    golden("ready", 24, 80);
}
END_TEST

START_TEST(a_folder_that_takes_no_logs_is_seen_before_the_start)
{
    choose("pendubot-mid", MK_PLANT_PENDUBOT);
    status.disk_free_mb = 42.0;
    news();
    ck_assert(drawn(24, 80, "NO  disk       42 MB"));
    status.disk_free_mb = -1.0;
    news();
    ck_assert(drawn(24, 80, "NO  disk       logs cannot be written"));
}
END_TEST

START_TEST(a_run_at_both_sizes_in_both_alphabets)
{
    run_for(4.0);
    event(HOST_COMMAND, "start");
    golden("running", 24, 80);
    golden("running-large", 40, 120);
    tui->canvas.unicode = false;
    golden("running-ascii", 24, 80);
}
END_TEST

START_TEST(a_fault_is_told_in_words)
{
    run_for(3.0);
    status.running = false;
    status.snap.state = MK_LOOP_FAULTED;
    status.snap.fault = MK_FAULT_TRAVEL;
    status.snap.fault_t = 2.84;
    status.snap.fault_joint = 1;
    event(HOST_ERROR, "fault travel at 2.84 s, joint 1: a joint left its travel limits");
    news();
    golden("fault", 24, 80);
}
END_TEST

START_TEST(after_a_run_its_summary_is_shown)
{
    run_for(4.0);
    status.running = false;
    status.snap.state = MK_LOOP_IDLE;
    snprintf(status.log_path, sizeof status.log_path, "runs/run-001.csv");
    status.have_summary = true;
    status.summary =
        (struct run_summary){.setup = "pendubot-mid",
                             .rig = "pendubot",
                             .seconds = 3.998,
                             .caught_t = 2.0,
                             .held_s = 1.998,
                             .balanced_at_end = true,
                             .rms = {0.0123, 0.0045},
                             .track_rms = (double)NAN,
                             .command = {{.name = "u", .unit = "", .peak = 10.0, .rms = 3.21}},
                             .commands = 1,
                             .late_max_us = 133.0,
                             .rows = 2000};
    news();
    golden("summary", 24, 80);
    press("\x1b");
    ck_assert(!tui->card.shown);
}
END_TEST

START_TEST(gains_are_shown_with_poles_and_help_with_what_can_be_done)
{
    run_for(1.0);
    press("g");
    golden("gains", 24, 80);
    golden("gains-large", 40, 120);
    press("\x1b?");
    golden("help", 24, 80);
}
END_TEST

/* A change is typed on the left and seen on the right. */
START_TEST(the_gains_stand_beside_the_scope_and_nothing_of_them_is_cut)
{
    static const int sizes[][2] = {{24, 80}, {40, 120}, {16, 60}};
    run_for(1.0);
    press("g");
    for (int i = 0; i < 3; i++) {
        int rows = sizes[i][0], cols = sizes[i][1];
        ck_assert_msg(drawn(rows, cols, "in force") && drawn(rows, cols, "scope"), "%d", cols);
        ck_assert_msg(drawn(rows, cols, "seconds"), "%d", cols); /* the scope's axis */
    }
    /* The words of every description, and the last of them. */
    for (int p = 0; p < status.setup->param_count; p++) {
        tui_draw(tui, 24, 80);
        char *screen = text_of(&tui->canvas), help[200], *rest = help, *word;
        snprintf(help, sizeof help, "%s", status.setup->param[p].help);
        while ((word = strsep(&rest, " ")) != NULL)
            ck_assert_msg(strstr(screen, word) != NULL, "no '%s' of %s", word,
                          status.setup->param[p].name);
        ck_assert_msg(strstr(screen, "first"), "%s", status.setup->param[p].name);
        free(screen);
        tui_key(tui, TK_DOWN);
    }
}
END_TEST

/* More parameters than rows: marks say where the list goes on. */
START_TEST(the_list_of_gains_says_where_it_goes_on)
{
    run_for(0.1);
    press("g");
    ck_assert(drawn(24, 80, " v\xe2\x94\x82"));
    ck_assert(!drawn(24, 80, " ^\xe2\x94\x82"));
    for (int p = 0; p < status.setup->param_count - 1; p++)
        tui_key(tui, TK_DOWN);
    ck_assert(drawn(24, 80, " ^\xe2\x94\x82"));
    ck_assert(!drawn(24, 80, " v\xe2\x94\x82"));
}
END_TEST

START_TEST(a_reference_is_changed_from_the_gains_of_a_setup_that_has_one)
{
    choose("pi-speed", MK_PLANT_INERTIA_WHEEL);
    news();
    press("gr");
    ck_assert_int_eq(tui->mode, MODE_PROMPT);
    press("60\n");
    ck_assert_str_eq(posted, "ref 60\n");
    choose("furuta", MK_PLANT_FURUTA);
    news();
    press("gr");
    ck_assert_int_eq(tui->mode, MODE_GAINS);
}
END_TEST

START_TEST(the_help_leaves_no_key_out)
{
    static const char *const keys[] = {"Space", "a ",  "h ", "r ",  "s ",  "g ",  "w ",   "e ",
                                       "i ",    "m ",  "p ", "Esc", "f ",  ": ",  "? ",   "q ",
                                       "[ ]",   "+ -", "= ", "Tab", "t ",  "> <", "Left", "PgUp",
                                       "Up",    "R ",  "^Z", "^L",  "1..6"};
    char text[16];
    run_for(1.0);
    press("?");
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++) {
        snprintf(text, sizeof text, " %s", keys[i]);
        ck_assert_msg(drawn(24, 80, text), "no '%s'", keys[i]);
    }
    /* Where there is no room for all, the weightiest are there. */
    ck_assert(drawn(TUI_MIN_ROWS, TUI_MIN_COLS, "motor off at once"));
    ck_assert(drawn(TUI_MIN_ROWS, TUI_MIN_COLS, "motor off, end"));
}
END_TEST

/* A log of 1000 samples and what a model makes of it; the caller shows them. */
static struct host_show some_log(void)
{
    struct mk_log *log, *model;
    ck_assert_int_eq(mk_log_create(1000, &log), MK_OK);
    ck_assert_int_eq(mk_log_create(1000, &model), MK_OK);
    static const char *const names[] = {"t", "q1", "q2", "u"};
    for (int c = 0; c < 4; c++) {
        double *a = mk_log_add_column(log, names[c]);
        double *b = c < 3 ? mk_log_add_column(model, names[c]) : NULL;
        for (int k = 0; k < 1000; k++) {
            struct mk_sample s = sample_at(k);
            a[k] = c == 0 ? s.t : c == 3 ? s.u : s.q[c - 1];
            if (b)
                b[k] = c == 0 ? s.t : 0.8 * a[k];
        }
    }
    return (struct host_show){log, model, false};
}

START_TEST(a_log_and_its_prediction_are_shown_beside_each_other)
{
    struct host_show show = some_log();
    choose("pendubot-mid", MK_PLANT_PENDUBOT);
    news();
    tui_show_log(tui, &show);
    golden("compare", 24, 80);
}
END_TEST

START_TEST(what_the_motor_does_is_told_whatever_is_shown)
{
    struct host_show show = some_log();
    run_for(1.0);
    tui_show_log(tui, &show);
    ck_assert(drawn(24, 80, "RUNNING"));
    status.running = false;
    news();
    ck_assert(!drawn(24, 80, "RUNNING"));
    status.snap.state = MK_LOOP_FAULTED;
    status.snap.fault = MK_FAULT_TRAVEL;
    news();
    ck_assert(drawn(24, 80, "FAULT"));
}
END_TEST

START_TEST(a_start_that_failed_has_no_figures_of_a_loop)
{
    choose("pendubot-mid", MK_PLANT_PENDUBOT);
    status.have_loop = true;
    status.snap.state = MK_LOOP_FAULTED;
    status.snap.fault = MK_FAULT_NOT_HANGING;
    news();
    ck_assert(drawn(24, 80, "500 Hz"));
    ck_assert(!drawn(24, 80, "NOT real time"));
    ck_assert(!drawn(24, 80, "late us"));
}
END_TEST

START_TEST(any_size_and_any_number_is_drawn)
{
    struct mk_sample s = sample_at(0);
    run_for(1.0);
    s.t = 2.0;
    s.q[0] = INFINITY, s.q[1] = (double)NAN, s.u = -1e300, s.v[0] = 1e-300;
    tui_add_sample(tui, &s);
    for (int rows = 1; rows < 70; rows += 3)
        for (int cols = 1; cols < 220; cols += 7)
            tui_draw(tui, rows, cols);
    ck_assert(drawn(10, 40, "too small"));
    ck_assert(drawn(10, 40, "E-STOP"));
}
END_TEST

START_TEST(nothing_that_is_said_can_steer_the_terminal)
{
    news();
    event(HOST_SAYS, "\x1b[2J\x07 \xff\xfe \xc3 \xf0\x9f\x98\x80 \xed\xa0\x80 end");
    ck_assert(drawn(24, 80, " end"));
    for (int i = 0; i < 24 * 80; i++)
        ck_assert(tui->canvas.cell[i].ch >= ' ');
}
END_TEST

/* --- keys ------------------------------------------------------------------------------------ */

START_TEST(a_key_is_a_shortcut_for_a_command_where_it_makes_sense)
{
    choose("pendubot-mid", MK_PLANT_PENDUBOT);
    news();
    press("ahweimp");
    ck_assert_str_eq(posted, ""); /* nothing has run: nothing to do with it */
    press("r");
    ck_assert_str_eq(posted, "start\n");
    status.running = status.have_loop = true;
    status.snap.state = MK_LOOP_RUNNING;
    news();
    press("rs");
    ck_assert_str_eq(posted, "start\n");
    press("h");
    ck_assert_int_eq(halts, 1);
    status.running = false;
    status.snap.state = MK_LOOP_FAULTED;
    snprintf(status.log_path, sizeof status.log_path, "a.csv");
    news();
    posted[0] = '\0';
    press("raiem");
    ck_assert_str_eq(posted, "ack\nidentify\nexplain\ncompare\n");
    posted[0] = '\0';
    press("w\n");
    ck_assert_str_eq(posted, "save pendubot-mid.csv\n");
    posted[0] = '\0';
    press("s4\n");
    ck_assert_str_eq(posted, "setup furuta\n");
}
END_TEST

START_TEST(a_blank_is_the_stop_unless_it_is_the_first_in_a_text)
{
    run_for(0.1);
    press(" ");
    ck_assert_int_eq(stops, 1);
    press("g ");
    ck_assert_int_eq(stops, 2);
    press("\x1b? ");
    ck_assert_int_eq(stops, 3);
    press("x: ");
    ck_assert_int_eq(stops, 4);
    press("echo a b");
    ck_assert_int_eq(stops, 4);
    press("  ");
    ck_assert_int_eq(stops, 5);
}
END_TEST

START_TEST(halt_and_estop_typed_do_not_queue_up)
{
    run_for(0.1);
    press(":halt\n:estop\n: \x1b");
    ck_assert_int_eq(halts, 1);
    ck_assert_int_eq(stops, 2);
    ck_assert_str_eq(posted, "");
}
END_TEST

START_TEST(quitting_in_mid_run_is_asked_for_once_more)
{
    run_for(0.1);
    press("q");
    ck_assert(drawn(24, 80, "The motor runs."));
    press("n");
    ck_assert(!tui->leave && halts == 0);
    press("qy");
    ck_assert(tui->leave && halts == 1);
}
END_TEST

START_TEST(gains_are_sent_together_and_unstable_ones_only_when_asked_twice)
{
    run_for(0.1);
    /* Designed gains, so that the loop is stable at first. */
    struct mk_ctrl *ctrl;
    ck_assert_int_eq(mk_ctrl_create(status.setup, &status.model, 0.002, NULL, &ctrl, NULL), MK_OK);
    memcpy(status.value, ctrl->value, sizeof status.value);
    memcpy(status.initial, ctrl->value, sizeof status.value);
    mk_ctrl_destroy(ctrl);
    news();
    press("g");
    tui_key(tui, TK_RIGHT);
    tui_key(tui, TK_DOWN);
    press("9.5\n");
    tui_key(tui, TK_UP);
    press("d");
    ck_assert_msg(strncmp(posted, "gains ", 6) == 0, "%s", posted);
    double k[4];
    ck_assert_int_eq(sscanf(posted, "gains %lf %lf %lf %lf", &k[0], &k[1], &k[2], &k[3]), 4);
    ck_assert_double_eq(k[0], 1.05 * status.value[0]);
    ck_assert_double_eq(k[1], 9.5);
    ck_assert_double_eq(k[3], status.value[3]);
    posted[0] = '\0';
    press("0\nd");
    ck_assert_str_eq(posted, "");
    ck_assert(drawn(24, 80, "UNSTABLE with these gains"));
    press("d");
    ck_assert_str_eq(posted, "set k_q1 0\n"); /* one alone goes by its name */
    posted[0] = '\0';
    int row = mk_ctrl_param_index(status.setup, "box_q1");
    for (int i = 0; i < row; i++)
        tui_key(tui, TK_DOWN);
    press("0.25\nd");
    ck_assert_str_eq(posted, "set box_q1 0.25\n");
    press("99\n");
    ck_assert(drawn(24, 120, "is outside 0 .. 3"));
    press("1e\n");
    ck_assert(drawn(24, 80, "'1e' is not a number"));
}
END_TEST

START_TEST(the_command_line_completes_what_is_known)
{
    static const struct {
        const char *typed, *becomes;
    } rows[] = {{"he", "help "},
                {"setup pendubot-t", "setup pendubot-top "},
                {"setup pend", "setup pendubot-"},
                {"set k_dq", "set k_dq"},
                {"set box_q1", "set box_q1 "},
                {"show st", "show stats "},
                {"limit runa", "limit runaway_s "},
                {"zzz", "zzz"},
                {"log ", "log o"}};
    choose("pendubot-mid", MK_PLANT_PENDUBOT);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct tui_prompt p = {.lines = 0};
        prompt_open(&p, ":", rows[i].typed);
        prompt_key(&p, TK_TAB, &status);
        ck_assert_str_eq(p.text, rows[i].becomes);
    }
}
END_TEST

START_TEST(a_text_is_edited_by_characters_not_bytes)
{
    struct tui_prompt p = {.lines = 0};
    prompt_open(&p, ":", "");
    const int keys[] = {'a', 0xe9, 0x20ac, 'b', TK_LEFT, TK_LEFT, TK_ERASE, 'x', TK_DELETE};
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++)
        prompt_key(&p, keys[i], &status);
    ck_assert_str_eq(p.text, "axb");
    prompt_remember(&p, "one");
    prompt_remember(&p, "two");
    prompt_key(&p, TK_UP, &status);
    prompt_key(&p, TK_UP, &status);
    ck_assert_str_eq(p.text, "one");
    prompt_key(&p, TK_DOWN, &status);
    prompt_key(&p, TK_DOWN, &status);
    ck_assert_str_eq(p.text, "axb");
    for (int i = 0; i < 1000; i++)
        prompt_key(&p, 0x20ac, &status);
    ck_assert_uint_lt(strlen(p.text), sizeof p.text);
}
END_TEST

/* --- scope and poles ------------------------------------------------------------------------- */

START_TEST(the_trigger_holds_the_picture_where_it_was_caught)
{
    run_for(6.0);
    tui->live.window_s = 1.0;
    while (tui->live.trigger != TRIGGER_CATCH)
        press("t");
    ck_assert(drawn(24, 80, "trigger: catch"));
    /* Caught at 2 s, which is a tenth of the window from its left. */
    ck_assert(drawn(24, 200, "2.5") && !drawn(24, 200, "5.5"));
    tui->live.trigger = TRIGGER_OFF;
    ck_assert(drawn(24, 200, "5.5"));
}
END_TEST

START_TEST(the_cursor_reads_out_the_samples)
{
    run_for(3.0);
    tui->live.cursor_t = 1.0;
    tui->live.cursor_on = tui->live.frozen = true;
    tui->live.end_t = 2.0;
    char q1[24];
    snprintf(q1, sizeof q1, "%.4f", sample_at(500).q[0]);
    ck_assert(drawn(24, 80, q1));
    press("\x1b");
    ck_assert(!tui->live.cursor_on);
}
END_TEST

/* Reached the other way round, upright is a whole turn on for the counter. */
START_TEST(an_upright_furuta_shows_0_whichever_way_it_went_up)
{
    choose("furuta", MK_PLANT_FURUTA);
    status.running = true;
    tui_set_status(tui, &status);
    for (int k = 0; k <= 1000; k++) {
        struct mk_sample m = {.t = k / 500.0, .ref = 0.0, .phase = MK_PHASE_SWINGUP};
        m.q[0] = 7.0; /* the arm keeps its turns: its cable does */
        m.q[1] = M_PI + M_PI * k / 1000.0;
        if (k == 1000)
            m.phase = MK_PHASE_BALANCE, m.q[1] = 2.0 * M_PI + 0.0125;
        tui_add_sample(tui, &m);
        if (k == 900)
            ck_assert_double_eq_tol((double)scope_find(&tui->live, 9.0)->y[CH_Q2], 1.9 * M_PI,
                                    1e-3);
    }
    ck_assert(drawn(24, 80, "q2     0.0125"));
    ck_assert(drawn(24, 80, "q1     7.0000"));
    /* The trace goes on where it was: nothing jumps. */
    for (size_t i = 1; i < tui->live.count; i++) {
        float step = scope_at(&tui->live, i)->y[CH_Q2] - scope_at(&tui->live, i - 1)->y[CH_Q2];
        ck_assert_double_lt(fabs((double)step), 0.1);
    }
}
END_TEST

START_TEST(a_peak_of_one_sample_is_seen)
{
    struct scope s;
    struct canvas c = {.unicode = true, .cell = NULL};
    ck_assert_int_eq(scope_init(&s, 20000), MK_OK);
    ck_assert_int_eq(canvas_resize(&c, 12, 60), MK_OK);
    s.window_s = 20.0;
    s.shown = 1u << CH_Q1;
    for (int k = 0; k < 10000; k++) {
        struct mk_sample m = {.t = k / 500.0, .ref = (double)NAN};
        m.q[0] = k == 5003 ? 1.0 : 0.0;
        scope_add(&s, &m);
    }
    scope_draw(&s, &c, (struct tui_rect){0, 0, 12, 60});
    int high = 0;
    for (int j = 12; j < 60; j++)
        high += c.cell[3 * 60 + j].ch != ' ';
    ck_assert_int_ge(high, 1);
    ck_assert_int_le(high, 2);
    scope_free(&s);
    canvas_free(&c);
}
END_TEST

START_TEST(poles_are_those_of_the_design_at_a_high_rate)
{
    struct linear lin;
    struct poles p;
    double re[4], im[4], k[4] = {80, 8, 100, 13};
    choose("pendubot-mid", MK_PLANT_PENDUBOT);
    linear_at(&status.model, linear_equilibrium(MK_PLANT_PENDUBOT, "pendubot-mid")->q, false, &lin);
    ck_assert_int_eq(mk_design_poles(4, lin.a, lin.b, k, re, im, NULL), MK_OK);
    poles_of_setup(status.setup, &status.model, 1e-5, status.value, &p);
    ck_assert_int_eq(p.n, 4);
    ck_assert(p.stable);
    for (int i = 0; i < 4; i++) /* both slowest first or last: as sets */
        ck_assert_double_eq_tol(p.re[i], re[3 - i], 0.01 * fabs(re[3 - i]));
    status.value[0] = 0.0;
    poles_of_setup(status.setup, &status.model, 0.002, status.value, &p);
    ck_assert(p.n == 4 && !p.stable);
}
END_TEST

START_TEST(too_slow_a_rate_is_seen_to_be_unstable)
{
    struct poles p;
    choose("pendubot-mid", MK_PLANT_PENDUBOT);
    poles_of_setup(status.setup, &status.model, 0.002, status.value, &p);
    ck_assert(p.stable);
    poles_of_setup(status.setup, &status.model, 0.05, status.value, &p);
    ck_assert(!p.stable);
}
END_TEST

/* --- chance ---------------------------------------------------------------------------------- */

static uint32_t chance(uint32_t *state)
{
    *state = *state * 1664525u + 1013904223u;
    return *state >> 8;
}

START_TEST(random_keys_and_states_never_break_the_screen)
{
    static const int special[] = {TK_LEFT,   TK_RIGHT,   TK_UP,        TK_DOWN,   TK_HOME,
                                  TK_END,    TK_PAGE_UP, TK_PAGE_DOWN, TK_DELETE, TK_BACK_TAB,
                                  TK_RETURN, TK_ESCAPE,  TK_TAB,       TK_ERASE,  0x20ac};
    static const char *const setups[] = {"pendubot-mid", "furuta", "pi-speed", "reaction-wheel"};
    static const enum mk_plant_kind plants[] = {MK_PLANT_PENDUBOT, MK_PLANT_FURUTA,
                                                MK_PLANT_INERTIA_WHEEL, MK_PLANT_REACTION_WHEEL};
    uint32_t state = 1;
    for (int k = 0; k < 30000; k++) {
        uint32_t c = chance(&state);
        tui_key(tui, c % 4 ? (int)(c / 4 % 127) + 1 : special[c / 4 % 15]);
        tui->leave = tui->suspend = false;
        if (c % 50 == 0) {
            choose(setups[c / 50 % 4], plants[c / 50 % 4]);
            status.have_loop = c / 200 % 2;
            status.running = status.have_loop && c / 400 % 2;
            status.snap.state = c / 800 % 3;
            status.have_summary = c / 2400 % 2;
            status.doing[0] = c / 4800 % 4 == 0 ? 'x' : '\0';
            news();
        }
        if (c % 7 == 0) {
            struct mk_sample s = sample_at(k);
            tui_add_sample(tui, &s);
            event(c % 4, "something");
        }
        if (c % 11 == 0)
            tui_draw(tui, (int)(c / 11 % 60) + 1, (int)(c / 660 % 200) + 1);
        posted[0] = '\0';
    }
    press("\x1b\x1b\x1b ");
    ck_assert_int_gt(stops, 0);
}
END_TEST

Suite *suite_tui(void)
{
    Suite *s = suite_create("tui");
    TCase *t = tcase_create("screen");
    tcase_add_checked_fixture(t, begin, end);
    tcase_set_timeout(t, 60);
    tcase_add_test(t, without_a_setup_it_says_how_to_begin);
    tcase_add_test(t, the_chosen_setup_is_in_sight_on_the_smallest_screen);
    tcase_add_test(t, limits_of_a_joint_that_slides_are_shown_in_metres);
    tcase_add_test(t, before_a_start_the_check_list_says_what_is_well);
    tcase_add_test(t, a_folder_that_takes_no_logs_is_seen_before_the_start);
    tcase_add_test(t, a_run_at_both_sizes_in_both_alphabets);
    tcase_add_test(t, a_fault_is_told_in_words);
    tcase_add_test(t, after_a_run_its_summary_is_shown);
    tcase_add_test(t, gains_are_shown_with_poles_and_help_with_what_can_be_done);
    tcase_add_test(t, the_gains_stand_beside_the_scope_and_nothing_of_them_is_cut);
    tcase_add_test(t, the_list_of_gains_says_where_it_goes_on);
    tcase_add_test(t, a_reference_is_changed_from_the_gains_of_a_setup_that_has_one);
    tcase_add_test(t, the_help_leaves_no_key_out);
    tcase_add_test(t, a_log_and_its_prediction_are_shown_beside_each_other);
    tcase_add_test(t, what_the_motor_does_is_told_whatever_is_shown);
    tcase_add_test(t, a_start_that_failed_has_no_figures_of_a_loop);
    tcase_add_test(t, any_size_and_any_number_is_drawn);
    tcase_add_test(t, nothing_that_is_said_can_steer_the_terminal);
    tcase_add_test(t, a_key_is_a_shortcut_for_a_command_where_it_makes_sense);
    tcase_add_test(t, a_blank_is_the_stop_unless_it_is_the_first_in_a_text);
    tcase_add_test(t, halt_and_estop_typed_do_not_queue_up);
    tcase_add_test(t, quitting_in_mid_run_is_asked_for_once_more);
    tcase_add_test(t, gains_are_sent_together_and_unstable_ones_only_when_asked_twice);
    tcase_add_test(t, the_command_line_completes_what_is_known);
    tcase_add_test(t, a_text_is_edited_by_characters_not_bytes);
    tcase_add_test(t, the_trigger_holds_the_picture_where_it_was_caught);
    tcase_add_test(t, the_cursor_reads_out_the_samples);
    tcase_add_test(t, an_upright_furuta_shows_0_whichever_way_it_went_up);
    tcase_add_test(t, a_peak_of_one_sample_is_seen);
    tcase_add_test(t, poles_are_those_of_the_design_at_a_high_rate);
    tcase_add_test(t, too_slow_a_rate_is_seen_to_be_unstable);
    tcase_add_test(t, random_keys_and_states_never_break_the_screen);
    suite_add_tcase(s, t);
    return s;
}

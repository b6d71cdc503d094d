/* Boards that say what cannot be: that drive otherwise than they were told and say so or deny it,
 * whose readings repeat, whose clock stands or races. The loop finds them out in time and stops;
 * one that only seems to lie it lets go on. The loop is that of support/bench.h, between it and the
 * virtual board stands the liar. */
#include "suites.h"

#include <math.h>

#include "ctrl/board_watch.h"
#include "mechkit/loop.h"
#include "support/bench.h"

/* What an exchange with the virtual board returns, put wrong from exchange `from` on. */
enum lie {
    DRIVES_ON,
    DRIVES_AND_DENIES,
    RUNS_ITSELF,
    REPEATS,
    CLOCK_STANDS,
    CLOCK_RACES,
    CLOCK_LEAPS,
    COUNTS_NONSENSE,
    LOSES_FOUR_OF_FIVE
};
static struct {
    enum lie lie;
    int from, exchanges;
    struct mk_board_sample kept;
} liar;

static enum mk_status lying_exchange(struct mk_board *board, double u, struct mk_board_sample *out)
{
    bool lies = liar.exchanges++ >= liar.from;
    if (lies && liar.lie == LOSES_FOUR_OF_FIVE && liar.exchanges % 5)
        return MK_ERR_TIMEOUT;
    bool drives = lies && (liar.lie == DRIVES_ON || liar.lie == DRIVES_AND_DENIES);
    enum mk_status st = bench.own->exchange(board, drives ? 10.0 : u, out);
    if (!lies)
        liar.kept = *out;
    else if (liar.lie == DRIVES_AND_DENIES)
        out->u_applied = u;
    else if (liar.lie == RUNS_ITSELF)
        out->status |= MK_BOARD_ST_OWN;
    else if (liar.lie == REPEATS)
        *out = liar.kept;
    else if (liar.lie == CLOCK_STANDS)
        out->board_ns = liar.kept.board_ns;
    else if (liar.lie == CLOCK_RACES)
        out->board_ns += 2 * (out->board_ns - liar.kept.board_ns);
    else if (liar.lie == CLOCK_LEAPS)
        out->board_ns += 8000000000000000000;
    else if (liar.lie == COUNTS_NONSENSE)
        out->sequence *= 2654435761u;
    return st;
}

static void build_liar(enum lie lie, int from)
{
    bench_build(NULL);
    liar.lie = lie;
    liar.from = from;
    liar.exchanges = 0;
    bench_override_board()->exchange = lying_exchange;
}

/* A run under u = 0 with a board that lies from its exchange `from` on; when the fault came, in s
 * after that exchange. The watch before the start takes 0.2 s: 100 exchanges at 500 Hz. */
static double lie_from(enum lie lie, int from, enum mk_fault fault)
{
    build_liar(lie, from);
    bench_run_into(fault, 5);
    double t = bench_look().fault_t;
    bench_halt();
    bench_restore_board();
    bench_assert_motor_is_off();
    return t - (from / bench.config.rate_hz - 0.2);
}

/* --- what it drives -------------------------------------------------------------------------- */

START_TEST(a_board_that_drives_when_it_is_told_not_to_is_stopped_at_once)
{
    ck_assert_double_eq_tol(lie_from(DRIVES_ON, 200, MK_FAULT_DISOBEYED), 0.0, 1e-9);
}
END_TEST

START_TEST(a_board_that_drives_before_the_start_is_not_started)
{
    build_liar(DRIVES_ON, 0);
    ck_assert_int_eq(mk_loop_start(bench.loop, NULL, NULL, 0, NULL), MK_ERR_FAULT);
    ck_assert_int_eq(bench_look().fault, MK_FAULT_DISOBEYED);
    ck_assert_int_eq(liar.exchanges, 1);
    bench_restore_board();
    bench_assert_motor_is_off();
}
END_TEST

/* Whose commands the host's are then is a matter of chance, whatever is in force. */
START_TEST(a_board_that_runs_a_controller_of_its_own_is_stopped_at_once)
{
    ck_assert_double_eq_tol(lie_from(RUNS_ITSELF, 200, MK_FAULT_DISOBEYED), 0.0, 1e-9);
}
END_TEST

START_TEST(a_board_that_drives_and_denies_it_is_found_by_the_motion)
{
    static const enum mk_plant_kind plants[] = {MK_PLANT_INERTIA_WHEEL, MK_PLANT_PENDUBOT,
                                                MK_PLANT_REACTION_WHEEL, MK_PLANT_FURUTA};
    bench_use_plant(plants[_i]);
    ck_assert_double_le(lie_from(DRIVES_AND_DENIES, 200, MK_FAULT_DRIVEN),
                        plants[_i] == MK_PLANT_PENDUBOT ? 0.4 : 0.1);
}
END_TEST

START_TEST(a_board_that_drives_and_denies_it_is_found_by_slow_samples_too)
{
    bench.config.rate_hz = MK_LOOP_RATE_MIN_HZ;
    bench_use_plant(MK_PLANT_INERTIA_WHEEL);
    ck_assert_double_le(lie_from(DRIVES_AND_DENIES, 40, MK_FAULT_DRIVEN), 0.3);
}
END_TEST

START_TEST(a_board_that_gives_less_than_it_is_told_goes_on)
{
    bench_build_driving("at 50 saturate 0.5", -1);
    bench_start();
    ck_assert_int_eq(bench_wait_for(1), MK_OK);
    ck_assert_double_eq(bench_look().sample.u, -0.5);
}
END_TEST

static struct {
    int exchanges;
    double command;
} belated;

/* A stream over a slow line: the sample behind command 100 is given up, and the command acts with
 * the next one. */
static enum mk_status belated_exchange(struct mk_board *board, double u,
                                       struct mk_board_sample *out)
{
    const int lost = 200; /* the watch before the start takes 100 exchanges */
    enum mk_status st = bench.own->exchange(board, u, out);
    if (belated.exchanges == lost + 1)
        out->u_applied = belated.command;
    if (belated.exchanges++ != lost)
        return st;
    belated.command = u;
    return MK_ERR_TIMEOUT;
}

START_TEST(a_command_whose_sample_was_lost_may_act_later)
{
    struct mk_signal *push;
    ck_assert_int_eq(mk_signal_create("1+pulse(0.197,0.199)", &push, NULL), MK_OK);
    bench.config.stream = true;
    bench_build(NULL);
    bench.ctrl.ref = push;
    belated.exchanges = 0;
    bench_override_board()->exchange = belated_exchange;
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.3), MK_OK);
    ck_assert_double_eq(belated.command, 2.0);
    ck_assert_uint_eq(bench_look().lost, 1);
    bench_halt();
    bench_restore_board();
    mk_signal_destroy(push);
}
END_TEST

/* Commands travel in millionths, and each way may round one. */
START_TEST(a_command_is_obeyed_to_two_millionths_and_anything_between_it_and_none_is_less)
{
    static const struct {
        double sent, applied;
        bool obeys;
    } rows[] = {{1.0, 1.0, true},    {1.0, 1.0 + 2e-6, true},    {1.0, 1.0 + 3e-6, false},
                {1.0, 0.5, true},    {1.0, 0.0, true},           {1.0, -2e-6, true},
                {1.0, -3e-6, false}, {-1.0, -1.0, true},         {-1.0, -1.0 - 2e-6, true},
                {-1.0, -0.5, true},  {-1.0, -1.0 - 3e-6, false}, {-1.0, 2e-6, true},
                {-1.0, 3e-6, false}, {0.0, 2e-6, true},          {0.0, -2e-6, true},
                {0.0, 3e-6, false},  {0.0, -3e-6, false},        {0.0, NAN, false}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        ck_assert_msg(mk_board_watch_obeys(rows[i].sent, rows[i].applied) == rows[i].obeys,
                      "%g of %g", rows[i].applied, rows[i].sent);
}
END_TEST

/* --- what it reads --------------------------------------------------------------------------- */

START_TEST(readings_that_repeat_an_exchange_are_stale)
{
    ck_assert_double_le(lie_from(REPEATS, 200, MK_FAULT_STALE), 0.01);
}
END_TEST

START_TEST(a_board_whose_clock_stands_still_is_stale)
{
    ck_assert_double_le(lie_from(CLOCK_STANDS, 200, MK_FAULT_STALE), 0.01);
}
END_TEST

START_TEST(a_board_whose_clock_races_is_stale)
{
    ck_assert_double_le(lie_from(CLOCK_RACES, 200, MK_FAULT_STALE), 0.2);
}
END_TEST

/* From a half to twice the host's, give or take 20 ms in 100; a second of samples. */
START_TEST(a_board_clock_may_be_off_by_two_and_no_more)
{
    static const struct {
        double pace;
        enum mk_fault fault;
    } rows[] = {{0.25, MK_FAULT_STALE},
                {0.35, MK_FAULT_NONE},
                {1.0, MK_FAULT_NONE},
                {2.15, MK_FAULT_NONE},
                {2.25, MK_FAULT_STALE}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct mk_board_watch watch = {0};
        enum mk_fault fault = MK_FAULT_NONE;
        mk_board_watch_reset(&watch, false, 5);
        for (uint32_t k = 0; k < 500 && fault == MK_FAULT_NONE; k++) {
            const int64_t host_ns = 2000000 * (int64_t)k;
            struct mk_board_sample reading = {
                .sequence = k, .board_ns = (int64_t)(rows[i].pace * (double)host_ns)};
            fault = mk_board_watch_step(
                &watch, &(struct mk_board_watch_sample){.reading = &reading, .host_ns = host_ns});
        }
        ck_assert_msg(fault == rows[i].fault, "at a pace of %g: %d", rows[i].pace, (int)fault);
    }
}
END_TEST

/* One step of a watch, with readings that go on. */
static enum mk_fault watch_step(struct mk_board_watch *w, int64_t host_ns, int64_t board_ns,
                                double sent, double applied)
{
    static uint32_t sequence;
    const struct mk_board_sample reading = {
        .sequence = ++sequence, .board_ns = board_ns, .u_applied = applied};
    return mk_board_watch_step(
        w, &(struct mk_board_watch_sample){.reading = &reading, .sent = sent, .host_ns = host_ns});
}

/* Wherever the two clocks stand when a run begins. Until 100 ms are over a board cannot be too
 * slow. */
START_TEST(clocks_are_compared_over_100_ms_of_the_host)
{
    static const struct {
        int64_t host_ns, board_ns;
        enum mk_fault fault;
    } rows[] = {{1, 220000000, MK_FAULT_NONE},         {1, 220000001, MK_FAULT_STALE},
                {99999999, 29999999, MK_FAULT_NONE},   {100000000, 30000000, MK_FAULT_NONE},
                {100000000, 29999999, MK_FAULT_STALE}, {100000000, 220000000, MK_FAULT_NONE},
                {100000000, 220000001, MK_FAULT_STALE}};
    static const int64_t begin[][2] = {{0, 0}, {5000000000, 7}, {7, 5000000000}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++)
        for (size_t k = 0; k < sizeof begin / sizeof begin[0]; k++) {
            struct mk_board_watch watch = {0};
            mk_board_watch_reset(&watch, false, MK_BOARD_CLOCK_WEIGHT);
            ck_assert_int_eq(watch_step(&watch, begin[k][0], begin[k][1], 0, 0), MK_FAULT_NONE);
            enum mk_fault fault = watch_step(&watch, begin[k][0] + rows[i].host_ns,
                                             begin[k][1] + rows[i].board_ns, 0, 0);
            ck_assert_msg(fault == rows[i].fault, "row %zu from %zu: %d", i, k, (int)fault);
        }
}
END_TEST

/* An answer to a streamed sample that is late acts with a later one; without a stream the command
 * of an exchange is in force with its reading. */
START_TEST(one_of_the_last_four_commands_is_in_force_with_a_stream_and_the_last_without)
{
    for (int streaming = 0; streaming < 2; streaming++)
        for (int ago = 0; ago < 6; ago++) {
            struct mk_board_watch watch = {0};
            enum mk_fault fault = MK_FAULT_NONE;
            mk_board_watch_reset(&watch, streaming, 5);
            for (int k = 0; k <= ago && fault == MK_FAULT_NONE; k++) {
                const int64_t ns = 2000000 * (k + 1);
                fault = watch_step(&watch, ns, ns, k ? 1.0 : -2.0, k == ago ? -2.0 : 0.0);
            }
            ck_assert_int_eq(fault == MK_FAULT_NONE, ago < (streaming ? MK_BOARD_WATCH_SENT : 1));
        }
}
END_TEST

/* A board that was opened again counts and tells the time from anywhere. */
START_TEST(a_watch_that_begins_anew_has_forgotten_the_run_before)
{
    struct mk_board_watch watch = {0};
    mk_board_watch_reset(&watch, true, MK_BOARD_CLOCK_WEIGHT);
    watch_step(&watch, 1000000000, 1000000000, 9.0, 9.0);
    ck_assert_int_eq(watch_step(&watch, 2000000000, 1000000001, 9.0, 9.0), MK_FAULT_STALE);
    mk_board_watch_reset(&watch, true, MK_BOARD_CLOCK_WEIGHT);
    ck_assert_int_eq(watch_step(&watch, 3000000000, 5, 0.0, 0.0), MK_FAULT_NONE);
    ck_assert_int_eq(watch_step(&watch, 3002000000, 2000005, 0.0, 0.0), MK_FAULT_NONE);
    ck_assert_int_eq(watch_step(&watch, 3004000000, 4000005, 0.0, 9.0), MK_FAULT_DISOBEYED);
}
END_TEST

START_TEST(a_board_whose_exchange_numbers_are_nonsense_is_stale)
{
    ck_assert_double_le(lie_from(COUNTS_NONSENSE, 200, MK_FAULT_STALE), 0.01);
}
END_TEST

START_TEST(a_board_that_loses_four_of_five_exchanges_is_stopped)
{
    ck_assert_double_le(lie_from(LOSES_FOUR_OF_FIVE, 200, MK_FAULT_LINK), 0.014);
}
END_TEST

/* Every third sample goes by while the host does something else. */
static enum mk_status belated_host(struct mk_board *board, double u, struct mk_board_sample *out)
{
    if (belated.exchanges++ % 3 == 2)
        (void)bench.own->exchange(board, u, out);
    return bench.own->exchange(board, u, out);
}

START_TEST(samples_that_a_host_has_missed_are_no_lies_of_the_board)
{
    bench.config.stream = true;
    bench_build(NULL);
    belated.exchanges = 0;
    bench_override_board()->exchange = belated_host;
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.5), MK_OK);
    ck_assert_int_eq(bench_look().fault, MK_FAULT_NONE);
    ck_assert_uint_ge(bench_look().overruns, 50);
    bench_halt();
    bench_restore_board();
}
END_TEST

START_TEST(a_streaming_board_whose_clock_stands_still_does_not_hold_the_host)
{
    bench.config.stream = true;
    ck_assert_double_le(lie_from(CLOCK_STANDS, 200, MK_FAULT_LINK), 0.1);
}
END_TEST

START_TEST(a_streaming_board_whose_clock_leaps_does_not_take_the_run_to_the_end_of_time)
{
    bench.config.stream = true;
    ck_assert_double_le(lie_from(CLOCK_LEAPS, 200, MK_FAULT_LINK), 0.1);
}
END_TEST

Suite *suite_loop_lies(void)
{
    Suite *s = suite_create("loop_lies");
    TCase *t = tcase_create("lies");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 20);
    tcase_add_test(t, a_board_that_drives_when_it_is_told_not_to_is_stopped_at_once);
    tcase_add_test(t, a_board_that_drives_before_the_start_is_not_started);
    tcase_add_test(t, a_board_that_runs_a_controller_of_its_own_is_stopped_at_once);
    tcase_add_loop_test(t, a_board_that_drives_and_denies_it_is_found_by_the_motion, 0, 4);
    tcase_add_test(t, a_board_that_drives_and_denies_it_is_found_by_slow_samples_too);
    tcase_add_test(t, a_board_that_gives_less_than_it_is_told_goes_on);
    tcase_add_test(t, a_command_whose_sample_was_lost_may_act_later);
    tcase_add_test(t,
                   a_command_is_obeyed_to_two_millionths_and_anything_between_it_and_none_is_less);
    tcase_add_test(t, samples_that_a_host_has_missed_are_no_lies_of_the_board);
    tcase_add_test(t, readings_that_repeat_an_exchange_are_stale);
    tcase_add_test(t, a_board_whose_clock_stands_still_is_stale);
    tcase_add_test(t, a_board_whose_clock_races_is_stale);
    tcase_add_test(t, a_board_clock_may_be_off_by_two_and_no_more);
    tcase_add_test(t, clocks_are_compared_over_100_ms_of_the_host);
    tcase_add_test(t, one_of_the_last_four_commands_is_in_force_with_a_stream_and_the_last_without);
    tcase_add_test(t, a_watch_that_begins_anew_has_forgotten_the_run_before);
    tcase_add_test(t, a_board_whose_exchange_numbers_are_nonsense_is_stale);
    tcase_add_test(t, a_board_that_loses_four_of_five_exchanges_is_stopped);
    tcase_add_test(t, a_streaming_board_whose_clock_stands_still_does_not_hold_the_host);
    tcase_add_test(t, a_streaming_board_whose_clock_leaps_does_not_take_the_run_to_the_end_of_time);
    suite_add_tcase(s, t);
    return s;
}

// What explain makes of the data that it is given: holes, late samples, lost pulses, long records
// of which a part is searched, logs that tell nothing.
#include "explain/training.hpp"

#include "suites.h"

#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "explain/search/missed_counts.hpp"
#include "mechkit/explain.h"
#include "support/pendulum.hpp"
extern "C" {
#include "support/files.h"
#include "support/program.h"
}

using namespace made_up;

namespace
{

// A loop on a busy machine: each exchange comes late, some a whole period and more, and then the
// sample after it is left out.
mk_log *record_late(double seconds)
{
    const size_t ticks = (size_t)(seconds * RATE);
    std::vector<double> t, y, u, late, flags;
    double q = 0.0, v = 0.0, command = 0.0, now = 0.0;
    unsigned random = 1;
    for (size_t tick = 0; tick < ticks; tick++) {
        random = random * 1664525u + 1013904223u;
        double delay = (random >> 8) % 1000 * 2.5e-6; // s, up to 2.5 ms of 4
        const bool stall = tick > 0 && random % 61u == 0;
        const size_t shown = tick + stall;
        if (stall)
            delay += 1.0 / RATE;
        const double exchange = (double)tick / RATE + (tick == 0 ? 0.0 : delay);
        for (; now + 0.5 * STEP < exchange; now += STEP)
            step({}, q, v, command);
        command = command_at((double)shown / RATE, 0);
        t.push_back((double)shown / RATE);
        y.push_back(COUNT * std::round(q / COUNT));
        u.push_back(command);
        late.push_back(tick == 0 ? 0.0 : 1e6 * delay);
        flags.push_back(stall ? 3.0 : delay > 0.5 / RATE ? 1.0 : 0.0);
        tick = shown;
    }
    mk_log *log = nullptr;
    ck_assert_int_eq(mk_log_create(t.size(), &log), MK_OK);
    const std::pair<const char *, const std::vector<double> *> columns[] = {
        {"t", &t}, {"q1", &y}, {"u", &u}, {"late_us", &late}, {"flags", &flags}};
    for (const auto &[name, values] : columns)
        std::copy(values->begin(), values->end(), mk_log_add_column(log, name));
    return log;
}

} // namespace

// Rows that nobody wrote, for most of a second: what the rig did meanwhile cannot be made up.
START_TEST(a_long_hole_in_a_log_is_not_bridged)
{
    Hidden h;
    h.drag = 0.012;
    mk_log *whole = record(h, 0, 6.0), *log = nullptr;
    const size_t first = 400, hole = 180, rows = whole->rows - hole;
    ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
    for (const char *name : {"t", "q1", "u"}) {
        const double *from = mk_log_get(whole, name);
        double *to = mk_log_add_column(log, name);
        for (size_t k = 0; k < rows; k++)
            to[k] = from[k < first ? k : k + hole];
    }
    mk_log_free(whole);
    mk_explanation e = explained(pendulum(false), log, record(h, 1, 5.0));
    ck_assert_int_eq(e.verdict, MK_VERDICT_EFFECT);
    ck_assert_int_eq(e.cause_count, 1);
    ck_assert_str_eq(e.cause[0].effect->name, "quadratic-drag");
    ck_assert_double_eq_tol(e.cause[0].value[0], 0.012, 6e-4);
    // Both parts, each from its first row to its last one.
    ck_assert_double_eq_tol(e.searched_s, (double)(rows - 2) / 250.0, 0.01);
}
END_TEST

START_TEST(samples_that_came_late_are_taken_for_when_they_came)
{
    mk_explanation e = explained(pendulum(true), record_late(8.0), nullptr);
    ck_assert_msg(e.verdict == MK_VERDICT_NONE, "%s %s", mk_verdict_name(e.verdict), e.structure);
    ck_assert_double_lt(e.process_noise_refit, 3e-4);
}
END_TEST

// With the board's own clock only the host was late.
START_TEST(samples_by_the_boards_clock_are_not_moved)
{
    mk_log *log = record({}, 0, 8.0);
    double *late = mk_log_add_column(log, "late_us"), *flags = mk_log_add_column(log, "flags");
    for (size_t k = 0; k < log->rows; k++) {
        late[k] = (double)(k * 7919 % 3900);
        flags[k] = late[k] > 2000.0 ? 1.0 : 0.0;
    }
    ck_assert_int_eq(mk_log_set_meta(log, "clock", "board"), MK_OK);
    mk_explanation e = explained(pendulum(true), log, nullptr);
    ck_assert_msg(e.verdict == MK_VERDICT_NONE, "%s %s", mk_verdict_name(e.verdict), e.structure);
    // Times that are off at random look like noise of the readings.
    ck_assert_double_lt(e.noise[0], 0.5 * COUNT);
}
END_TEST

START_TEST(of_long_records_a_part_is_searched_and_said)
{
    Hidden h;
    h.drag = 0.012;
    mk_explanation e = explained(h, false, 3.0);
    ck_assert_double_eq_tol(e.given_s, 6.0, 0.01);
    ck_assert_double_eq_tol(e.searched_s, 3.0, 0.01);
    ck_assert(e.verdict == MK_VERDICT_EFFECT && named(e, "quadratic-drag"));
}
END_TEST

START_TEST(parameters_come_of_all_data_though_a_part_is_searched)
{
    Hidden h;
    const mk_explanation all = explained(h), part = explained(h, false, 2.0);
    ck_assert_double_lt(part.searched_s, 0.5 * part.given_s);
    // Of a third of the data errors would be some 1.7 times as large.
    for (int i = 0; i < 2; i++) {
        ck_assert_double_eq_tol(part.std_error[i], all.std_error[i], 0.1 * all.std_error[i]);
        ck_assert_double_eq_tol(part.refit.parameter[i], all.refit.parameter[i],
                                0.3 * all.std_error[i]);
    }
}
END_TEST

// The windows that are searched of logs of some lengths, in s, with another one to measure on.
static mk::TrainingData searched(const std::vector<double> &lengths, double most_s)
{
    std::vector<mk::OwnedLog> logs;
    std::vector<const mk_log *> given;
    for (double seconds : lengths) {
        logs.emplace_back(record({}, 0, seconds));
        given.push_back(logs.back().get());
    }
    const mk::OwnedLog hold(record({}, 1, 5.0));
    const mk_log *held = hold.get();
    mk::TrainingData data;
    mk_explain_options options = {};
    options.most_s = most_s;
    auto e = std::make_unique<mk_explanation>();
    mk_error err = MK_ERROR_INIT;
    const mk_model model = pendulum(true);
    const enum mk_status st =
        data.load(model, options, given.data(), given.size(), &held, 1, *e, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    return data;
}

START_TEST(of_several_long_logs_a_part_of_each_is_searched)
{
    const std::vector<double> rows[] = {
        {9, 9, 9, 9}, {60}, {100, 5, 5, 5}, {6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6, 6}};
    const std::vector<double> &lengths = rows[_i];
    const mk::TrainingData data = searched(lengths, 30.0);
    std::vector<double> taken(lengths.size(), 0.0), first(lengths.size(), HUGE_VAL);
    std::vector<double> last(lengths.size(), 0.0);
    double all = 0.0, together = 0.0;
    for (const mk::FitLog &log : data.logs) {
        const auto i = (size_t)log.source;
        taken[i] += log.duration();
        first[i] = std::fmin(first[i], log.start);
        last[i] = std::fmax(last[i], log.start + log.duration());
    }
    for (size_t i = 0; i < lengths.size(); i++)
        all += lengths[i], together += taken[i];
    ck_assert_double_eq_tol(together, 30.0, 3.0);
    for (size_t i = 0; i < lengths.size(); i++) {
        ck_assert_msg(taken[i] > 0.4 * lengths[i] / all * 30.0, "%g s of log %zu", taken[i], i);
        ck_assert_double_lt(first[i], 0.5 * lengths[i]);
        ck_assert_double_gt(last[i], 0.5 * lengths[i]);
    }
    if (lengths.size() == 1) // from near its start to near its end
        ck_assert(first[0] < 5.0 && last[0] > 55.0);
}
END_TEST

START_TEST(with_more_logs_than_windows_those_are_spread_over_them)
{
    const mk::TrainingData data = searched(std::vector<double>(12, 3.0), 4.0);
    ck_assert_uint_eq(data.logs.size(), 4);
    for (size_t i = 0; i < 4; i++)
        ck_assert(data.logs[i].source / 3 == (int)i && data.logs[i].duration() > 0.9);
}
END_TEST

START_TEST(lost_pulses_are_found)
{
    Hidden h;
    h.missed_count = 20.0 * COUNT;
    mk_explanation e = explained(h);
    ck_assert_int_eq(e.verdict, MK_VERDICT_EFFECT);
    ck_assert_str_eq(e.cause[0].effect->name, "missed-counts");
    ck_assert_double_eq_tol(e.cause[0].value[0], h.missed_count, COUNT);
    // Those of the held-out data are no fault of the model.
    ck_assert_int_eq(e.held_counts_corrected, 2);
    ck_assert_double_lt(e.after[0], 3.0 * e.floor[0]);
}
END_TEST

// Fast motion with steps of a few counts, one of them beside a missing row.
START_TEST(small_steps_of_a_fast_reading_are_lost_pulses_and_a_single_one_may_be_chance)
{
    constexpr double COARSE = 2.0 * M_PI / 2048.0, JUMP = 6.3 * COARSE;
    mk::FitLog log = {};
    log.joints = 1;
    log.count[0] = COARSE;
    const size_t at[] = {300, 901, 1500};
    for (size_t k = 0; k < 2000; k++) {
        double t = 0.004 * (double)k, q = 4.0 * std::sin(7.0 * t) + std::sin(23.0 * t);
        q += (k >= at[0]) * JUMP - (k >= at[1]) * JUMP + (k >= at[2]) * JUMP;
        log.t.push_back(t);
        log.q[0].push_back(k == at[1] + 1 ? (double)NAN : std::round(q / COARSE) * COARSE);
    }
    std::vector<mk::MissedCount> found = mk::find_missed_counts({&log}, 0);
    ck_assert_uint_eq(found.size(), 3);
    for (size_t i = 0; i < 3; i++) {
        ck_assert_uint_eq(found[i].row, at[i]);
        ck_assert_double_eq_tol(found[i].step, i == 1 ? -JUMP : JUMP, 1.5 * COARSE);
    }
    ck_assert(mk::surely_steps(found));
    found.resize(1); // a push may look like a step
    ck_assert(!mk::surely_steps(found));
}
END_TEST

// A joint that bounces to and fro between two walls, each time between two readings.
START_TEST(a_bounce_is_surely_no_lost_pulse)
{
    constexpr double DT = 0.004, SPEED = 6.0, GAP = 2.0;
    for (double within : {0.1, 0.3, 0.5, 0.7, 0.9}) {
        mk::FitLog log = {};
        log.joints = 1;
        log.count[0] = COUNT;
        for (int k = 0; k < 2000; k++) {
            const double way = std::fmod(SPEED * DT * (k + within), 2.0 * GAP);
            const double q = way < GAP ? way : 2.0 * GAP - way;
            log.t.push_back(DT * k);
            log.q[0].push_back(COUNT * std::round(q / COUNT));
        }
        const std::vector<mk::MissedCount> found = mk::find_missed_counts({&log}, 0);
        ck_assert_uint_gt(found.size(), 0); // which a model has to tell apart
        ck_assert(!mk::surely_steps(found));
    }
}
END_TEST

START_TEST(lost_pulses_beside_missing_rows_are_found)
{
    constexpr double JUMP = 20.0 * COUNT;
    for (int missing = -5; missing < 5; missing++) {
        mk::FitLog log;
        log.joints = 1;
        log.count[0] = COUNT;
        for (int k = 0; k < 400; k++) {
            double angle = 0.8 * std::sin(0.01 * k) + (k >= 200 ? JUMP : 0.0);
            log.q[0].push_back(k == 200 + missing ? (double)NAN
                                                  : COUNT * std::round(angle / COUNT));
        }
        std::vector<mk::MissedCount> found = mk::find_missed_counts({&log}, 0);
        ck_assert_msg(found.size() == 1, "row %d missing: %zu found", missing, found.size());
        ck_assert_double_eq_tol(found[0].step, JUMP, COUNT);
    }
}
END_TEST

// A light wheel whose torque steps: no parabola goes on beyond that.
START_TEST(steps_of_a_wheel_s_acceleration_are_no_lost_pulses)
{
    constexpr double FINE_COUNT = 2.0 * M_PI / 8192.0, DT = 0.005;
    mk::FitLog log = {};
    log.joints = 1;
    log.count[0] = FINE_COUNT;
    double q = 0.0, v = -80.0;
    for (size_t k = 0; k < 2400; k++) {
        constexpr int FINE = 50;
        log.t.push_back(DT * (double)k);
        log.q[0].push_back(std::round(q / FINE_COUNT) * FINE_COUNT);
        for (int i = 0; i < FINE; i++) {
            double t = DT * ((double)k + (double)i / FINE);
            double a = std::sin(2.0 * M_PI * 1.43 * t) > 0.0 ? 900.0 : -900.0;
            q += DT / FINE * v, v += DT / FINE * a;
        }
    }
    ck_assert_uint_eq(mk::find_missed_counts({&log}, 0).size(), 0);
}
END_TEST

// Nothing is to be measured on a rest.
START_TEST(of_a_log_that_ends_at_rest_the_end_of_its_motion_is_held_back)
{
    for (bool long_rest : {true, false}) {
        mk_log *data = record({}, 0, 6.0);
        mk_log *log = nullptr;
        const size_t rest = long_rest ? 3000 : 100, rows = data->rows + rest;
        ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
        for (const char *name : {"t", "q1", "u"}) {
            const double *from = mk_log_get(data, name);
            double *to = mk_log_add_column(log, name);
            for (size_t k = 0; k < rows; k++)
                to[k] = *name == 't'
                            ? (double)k / 250.0
                            : from[std::min(k, data->rows - 1)] * (k < data->rows || *name == 'q');
        }
        mk_log_free(data);
        // The rest itself is not physical (something holds the rig), nor looked at.
        mk_explanation e = explained(pendulum(true), log, nullptr, 0.0, true);
        ck_assert(e.held_back);
        ck_assert_double_eq_tol(e.held_to, long_rest ? 6.0 : 6.4, 0.02);
        ck_assert_double_eq_tol(e.held_from, long_rest ? 4.5 : 4.8, 0.02);
        ck_assert_double_gt(e.floor[0], 0.0);
    }
}
END_TEST

START_TEST(a_log_without_motion_is_refused)
{
    const mk_model model = pendulum(true);
    Hidden h;
    h.dead = 100.0;
    mk_log *log = record(h, 0, 2.0);
    mk_explanation e;
    mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_explain(&model, &log, 1, nullptr, 0, nullptr, &e, &err), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "nothing moves"));
    mk_log_free(log);
}
END_TEST

// What is wrong with a log, held out or not, is said before a search.
START_TEST(a_log_that_tells_nothing_is_refused_at_once)
{
    static const struct {
        const char *column; // whose values change; meta: it is of another rig
        double value;
        bool all;
        int line;
        const char *says;
    } rows[] = {{"u", HUGE_VAL, false, 107, "the command is infinite; a missing value is"},
                {"q1", -HUGE_VAL, false, 107, "q1 is infinite"},
                {"u", 1e300, false, 107, "the command is 1e+300: no rig goes beyond 100000, ten"},
                {"q1", -1e30, false, 107, "q1 is -1e+30: no rig goes beyond 1e+06 rad"},
                {"u", NAN, true, 0, "the command has no values"},
                {"q1", NAN, true, 0, "q1 has no values"},
                {"t", 1000.0, true, 0, "is t in seconds?"},
                {"meta", 0.0, true, 0, "the log is of the rig pendubot"},
                {"q1", 0.5, true, 0, "nothing moves in this log"}};
    const mk_model model = pendulum(true);
    const auto &row = rows[_i / 2];
    mk_log *good = record({}, 0, 2.0), *bad = record({}, 1, 2.0);
    bad->first_row_line = 7;
    if (strcmp(row.column, "meta") == 0)
        ck_assert_int_eq(mk_log_set_meta(bad, "rig", "pendubot"), MK_OK);
    for (size_t c = 0; c < bad->column_count; c++)
        for (size_t k = 0; k < bad->rows && strcmp(bad->columns[c].name, row.column) == 0; k++)
            if (strcmp(row.column, "t") == 0)
                bad->columns[c].data[k] *= row.value;
            else if (row.all || k == 100)
                bad->columns[c].data[k] = row.value;
    mk_explanation e;
    mk_error err = MK_ERROR_INIT;
    mk_explain_options options = {};
    bool searched = false;
    options.threads = 2;
    options.progress_context = &searched;
    options.progress = [](void *context, double, const char *) {
        *(bool *)context = true;
        return false;
    };
    mk_log *train = _i % 2 ? good : bad, *hold = _i % 2 ? bad : good;
    ck_assert_int_ne(mk_explain(&model, &train, 1, &hold, 1, &options, &e, &err), MK_OK);
    ck_assert(!searched);
    ck_assert_msg(strstr(err.message, row.says) != nullptr, "%s", err.message);
    ck_assert_int_eq(err.line, row.line);
    if (row.line > 0) {
        mk_ident_result fit;
        err = MK_ERROR_INIT;
        ck_assert_int_eq(mk_identify(&model, &bad, 1, nullptr, &fit, &err), MK_ERR_RANGE);
        ck_assert_msg(strstr(err.message, row.says) != nullptr, "%s", err.message);
        ck_assert_int_eq(err.line, row.line);
    }
    mk_log_free(good);
    mk_log_free(bad);
}
END_TEST

// Before a search or a fit: what cannot be is refused, what is likely and what the metadata
// contradict is said.
START_TEST(what_is_wrong_with_a_log_is_said_first)
{
    constexpr double TURN = 2.0 * M_PI;
    static const struct {
        double slope, turn, factor, u; // of q1: rad/s put on top, wrapped to, times; of u: times
        const char *key, *value;
        bool refused;
        const char *says;
    } rows[] = {
        {0, 0, 1, 1, nullptr, nullptr, false, nullptr},
        {2, TURN, 1, 1, nullptr, nullptr, true, "it is wrapped to one turn\n"},
        {2, TURN, 360 / TURN, 1, nullptr, nullptr, true, "turn, and in degrees"},
        {0, 0, 360 / TURN, 1, nullptr, nullptr, true, "with [q1] unit = deg\n"},
        {0, 0, 4000 / TURN, 1, nullptr, nullptr, true, "in raw counts, but angles are in rad"},
        {0, 0, 1, -1, nullptr, nullptr, true, "if so, mechkit import --map with [u] sign = -1"},
        {0, 0, 1, 1, "u_to_torque", "0.0057", false, "u_to_torque is 0.0057 here, 0.00494 in"},
        {0, 0, 1, 1, "u_to_torque", "many", false, "u_to_torque: 'many' is no number above 0"},
        {0, 0, 1, 1, "encoder_cpr", "2048", false, "encoder_cpr of joint 1 is 2048 here, 4000 in"},
        {0, 0, 1, 1, "sample_rate_hz", "500", false, "0.004 s apart, are one in 2 of those"},
        {0, 0, 1, 1, "sample_rate_hz", "300", false, "but the rows are 0.004 s apart (250 Hz)"},
        {0, 0, 1, 1, "encoder_cpr", "1e300", false, "1e300' is no number of counts a"},
        {0, 0, 1e200, 1, nullptr, nullptr, false, "no rig goes beyond 1e+06 rad"},
        {0, 0, 1, 1000, nullptr, nullptr, true, "in 1496 of 1500 rows, where it is taken as"},
        {0, 0, 1, NAN, nullptr, nullptr, false, "50 % of the commands are missing, and made up"},
        {0, 0, NAN, 1, nullptr, nullptr, false, "50 % of the readings of q1 are missing"},
    };
    const auto &row = rows[_i];
    char out[2048], model[512], log[512], folder[512];
    mk_error err = MK_ERROR_INIT;
    const mk_model rig = pendulum(false);
    mk_log *data = record({}, 0, 6.0);
    for (size_t c = 0; c < data->column_count; c++)
        for (size_t k = 0; k < data->rows; k++) {
            double &x = data->columns[c].data[k];
            if (strcmp(data->columns[c].name, "q1") == 0 && (k % 2 || !std::isnan(row.factor))) {
                x += row.slope * TURN / 4000.0 * (double)k;
                x = row.factor * (row.turn > 0.0 ? std::remainder(x, row.turn) : x);
            } else if (strcmp(data->columns[c].name, "u") == 0 && (k % 2 || !std::isnan(row.u))) {
                x *= row.u;
            }
        }
    if (row.key)
        ck_assert_int_eq(mk_log_set_meta(data, row.key, row.value), MK_OK);
    snprintf(model, sizeof model, "%s", scratch("rig.ini"));
    snprintf(log, sizeof log, "%s", scratch("run.csv"));
    snprintf(folder, sizeof folder, "%s", scratch("doubts"));
    ck_assert_int_eq(mk_model_write(model, &rig, nullptr, &err), MK_OK);
    ck_assert_int_eq(mk_log_write(log, data, &err), MK_OK);
    mk_log_free(data);
    int code = run_mechkit(out, sizeof out, "identify --method olsen --model %s --json %s %s",
                           model, scratch("doubts.json"), log);
    ck_assert_msg((code == 1) == row.refused || row.u != 1.0 || row.factor != 1.0, "%d %s", code,
                  out);
    if (row.says)
        ck_assert_msg(strstr(out, row.says) && strstr(out, log), "%s", out);
    else
        ck_assert_msg(strncmp(out, "mechkit", 7) != 0, "%s", out);
    if (!row.refused)
        return;
    code = run_mechkit(out, sizeof out, "explain --model %s --out %s %s", model, folder, log);
    ck_assert_msg(code == 1 && strstr(out, row.says), "%d %s", code, out);
    ck_assert_int_eq(count_files("doubts"), 0);
}
END_TEST

Suite *suite_explain_data(void)
{
    Suite *s = suite_create("explain_data");
    TCase *t = tcase_create("data");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, samples_that_came_late_are_taken_for_when_they_came);
    tcase_add_test(t, samples_by_the_boards_clock_are_not_moved);
    tcase_add_loop_test(t, of_several_long_logs_a_part_of_each_is_searched, 0, 4);
    tcase_add_test(t, with_more_logs_than_windows_those_are_spread_over_them);
    tcase_add_test(t, small_steps_of_a_fast_reading_are_lost_pulses_and_a_single_one_may_be_chance);
    tcase_add_test(t, a_bounce_is_surely_no_lost_pulse);
    tcase_add_test(t, lost_pulses_beside_missing_rows_are_found);
    tcase_add_test(t, steps_of_a_wheel_s_acceleration_are_no_lost_pulses);
    tcase_add_test(t, of_a_log_that_ends_at_rest_the_end_of_its_motion_is_held_back);
    tcase_add_test(t, a_log_without_motion_is_refused);
    tcase_add_loop_test(t, a_log_that_tells_nothing_is_refused_at_once, 0, 18);
    tcase_add_loop_test(t, what_is_wrong_with_a_log_is_said_first, 0, 16);
    suite_add_tcase(s, t);

    t = tcase_create("more data");
    tcase_set_timeout(t, 120);
    tcase_set_tags(t, "long");
    tcase_add_test(t, a_long_hole_in_a_log_is_not_bridged);
    tcase_add_test(t, of_long_records_a_part_is_searched_and_said);
    tcase_add_test(t, parameters_come_of_all_data_though_a_part_is_searched);
    tcase_add_test(t, lost_pulses_are_found);
    suite_add_tcase(s, t);
    return s;
}

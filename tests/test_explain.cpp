// Effects hidden in data, which explain must find. The data come from a simulator of their own: a
// pendulum as a torque balance in steps of 20 us, friction and contact resolved, quantised
// readings.
#include "explain/search/candidates.hpp"

#include "suites.h"

#include <cmath>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "explain/evidence/verdict.hpp"
#include "explain/search/log_values.hpp"
#include "explain/search/missed_counts.hpp"
#include "explain/training.hpp"
#include "mechkit/explain.h"
#include "mechkit/json.h"
extern "C" {
#include "console/commands/explanation.h"
#include "support/files.h"
#include "support/program.h"
}

namespace
{

constexpr double J = 0.0611, MGL = 6.9, C = 0.0123, F = 0.352;

// What is hidden, in the pendulum's own terms.
struct Hidden {
    double drag = 0.0;         // v|v|
    double cubic = 0.0;        // v^3
    double dead = 0.0;         // of the amplifier
    double delay = 0.0;        // s
    double tilt = 0.0;         // rad
    double missed_count = 0.0; // rad, at two instants
    bool bumper = false;       // a stop at 0.6 rad
};

double balance(const Hidden &h, double q, double v, double u)
{
    double command = std::fabs(u) <= h.dead ? 0.0 : u - std::copysign(h.dead, u);
    double torque = command - MGL * std::sin(q - h.tilt) - C * v - F * std::tanh(15.0 * v);
    torque -= h.drag * v * std::fabs(v) + h.cubic * v * v * v;
    if (h.bumper && q > 0.6)
        torque -= std::fmax(0.0, 60.0 * (q - 0.6) + 0.4 * v);
    return torque / J;
}

double command_at(double t, int kind)
{
    if (t < 0.0)
        return 0.0;
    if (kind == 0)
        return 3.0 * std::sin(7.3 * t) + 2.0 * std::sin(11.9 * t + 0.7) + std::sin(4.1 * t);
    return 4.5 * std::sin((3.0 + 1.1 * t) * t);
}

mk_log *record(const Hidden &h, int kind, double seconds)
{
    constexpr double RATE = 250.0, STEP = 2e-5, COUNT = 2.0 * M_PI / 4000.0;
    size_t rows = (size_t)(seconds * RATE);
    mk_log *log = nullptr;
    ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
    double *t = mk_log_add_column(log, "t"), *y = mk_log_add_column(log, "q1");
    double *u = mk_log_add_column(log, "u");
    double q = 0.0, v = 0.0, correction = 0.0;
    int per_row = (int)std::lround(1.0 / (RATE * STEP));
    for (size_t k = 0; k < rows; k++) {
        t[k] = (double)k / RATE;
        u[k] = command_at(t[k], kind);
        if (k == rows / 3 || k == rows / 2)
            correction += k == rows / 3 ? h.missed_count : -h.missed_count;
        y[k] = COUNT * std::round((q + correction) / COUNT);
        for (int i = 0; i < per_row; i++) {
            // The command is held from row to row; what acts is what was sent a delay ago.
            double held = std::floor((t[k] + i * STEP - h.delay) * RATE + 1e-9) / RATE;
            double acting = command_at(held, kind);
            // Midpoint rule.
            double a = balance(h, q, v, acting);
            double vm = v + 0.5 * STEP * a, qm = q + 0.5 * STEP * v;
            q += STEP * vm;
            v += STEP * balance(h, qm, vm, acting);
        }
    }
    return log;
}

// The pendulum without what is hidden.
mk_model pendulum(bool exact)
{
    mk_model model;
    mk_model_default(MK_PLANT_PENDULUM, &model);
    const double truth[4] = {J, MGL, C, F};
    for (int i = 0; i < 4; i++)
        model.parameter[i] = truth[i] * (exact ? 1.0 : i % 2 ? 1.1 : 0.92);
    return model;
}

// Frees the logs; `hold` may be null.
mk_explanation explained(const mk_model &model, mk_log *train, mk_log *hold, double most_s = 0.0,
                         bool keep_all = false)
{
    mk_explanation e;
    mk_error err = MK_ERROR_INIT;
    mk_explain_options options = {};
    options.threads = 2;
    options.most_s = most_s;
    options.rows.keep_all = keep_all;
    enum mk_status st = mk_explain(&model, &train, 1, &hold, hold ? 1 : 0, &options, &e, &err);
    ck_assert_msg(st == MK_OK, "%s", err.message);
    mk_log_free(train);
    mk_log_free(hold);
    return e;
}

mk_explanation explained(const Hidden &h, bool exact = false, double most_s = 0.0)
{
    return explained(pendulum(exact), record(h, 0, 6.0), record(h, 1, 5.0), most_s);
}

// A loop on a busy machine: each exchange comes late, some a whole period and more, and then the
// sample after it is left out.
mk_log *record_late(double seconds)
{
    constexpr double RATE = 250.0, STEP = 2e-5, COUNT = 2.0 * M_PI / 4000.0;
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
        for (; now + 0.5 * STEP < exchange; now += STEP) {
            double a = balance({}, q, v, command);
            double vm = v + 0.5 * STEP * a, qm = q + 0.5 * STEP * v;
            q += STEP * vm;
            v += STEP * balance({}, qm, vm, command);
        }
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

bool named(const mk_explanation &e, const char *name)
{
    for (int i = 0; i < e.cause_count; i++)
        if (strcmp(e.cause[i].effect->name, name) == 0)
            return true;
    for (int i = 0; i < e.rival_count; i++)
        if (!e.rival[i].distinguishable && strcmp(e.rival[i].effect->name, name) == 0)
            return true;
    return false;
}

} // namespace

// The least probability by chance of all tests of what a model leaves.
static double least_chance(const mk_explanation &e, bool extended)
{
    double p = 1.0;
    for (int i = 0; i < e.residual_test_count; i++) {
        const mk_residual_test &t = e.residual_test[i];
        p = std::fmin(p, extended ? t.p_after : t.p_before);
    }
    return p * e.residual_test_count;
}

// A free run from the catch of a double inverted pendulum grows from the smallest error at its
// start, in the training data as well as in held-out data.
START_TEST(upright_runs_of_the_exact_model_raise_no_doubt)
{
    static char out[16384];
    std::string folder = scratch("upright"), model = MK_SOURCE_DIR "/models/pendubot.ini";
    for (const char *hold : {"1", "2"}) {
        std::string text = "setup pendubot-top\nstart\nwait-until balanced within 15\nwait ";
        text = text + hold + "\nhalt\nsave t" + hold + ".csv\n";
        std::string script = scratch_text("upright.cmd", text.c_str());
        ck_assert_int_eq(run_mechkit(out, sizeof out, "run %s --fast --model %s --out %s",
                                     script.c_str(), model.c_str(), folder.c_str()),
                         0);
    }
    int code = run_mechkit(out, sizeof out,
                           "explain --model %s --out %s/report --holdout %s/t1.csv %s/t2.csv",
                           model.c_str(), folder.c_str(), folder.c_str(), folder.c_str());
    ck_assert_msg(code == 0 && strstr(out, "The model explains the data."), "%s", out);
    ck_assert_msg(!strstr(out, "far worse than they are read"), "%s", out);
}
END_TEST

START_TEST(one_step_predictions_of_a_right_model_leave_white_noise)
{
    mk_explanation right = explained({}, true);
    ck_assert_int_gt(right.residual_test_count, 0);
    ck_assert_double_gt(least_chance(right, true), 0.01);
    ck_assert_double_eq_tol(right.one_step_extended[0], 1.0, 0.05);
    Hidden h;
    h.drag = 0.05;
    mk_explanation e = explained(h);
    ck_assert_double_lt(least_chance(e, false), 1e-6);
    ck_assert_double_gt(e.one_step_refit[0], 2.0);
    ck_assert_double_gt(least_chance(e, true), 0.01);
    ck_assert_double_eq_tol(e.one_step_extended[0], 1.0, 0.05);
}
END_TEST

START_TEST(a_right_model_raises_no_alarm)
{
    mk_explanation e = explained({}, true);
    ck_assert_str_eq(mk_verdict_name(e.verdict), "none");
    ck_assert_int_eq(e.cause_count, 0);
}
END_TEST

START_TEST(wrong_values_are_told_from_missing_physics)
{
    mk_explanation e = explained({});
    ck_assert_str_eq(mk_verdict_name(e.verdict), "parameters");
    ck_assert_double_eq_tol(e.extended.parameter[0], J, 4.0 * e.std_error[0]);
    ck_assert_double_lt(e.after[0], 0.2 * e.before[0]);
}
END_TEST

// Quantiles of the chi-square distribution at 1 - 1e-4, from tables.
START_TEST(values_are_called_wrong_where_one_data_set_in_ten_thousand_would_say_so)
{
    static const struct {
        int parameters;
        double quantile;
    } row[] = {{1, 15.137}, {2, 18.421}, {5, 25.745}, {7, 29.878}, {10, 35.564}};
    for (const auto &r : row) {
        ck_assert(!mk::beyond_chance(0.0, r.parameters));
        ck_assert(!mk::beyond_chance(r.quantile - 0.02, r.parameters));
        ck_assert(mk::beyond_chance(r.quantile + 0.02, r.parameters));
    }
}
END_TEST

START_TEST(a_hidden_effect_is_named_and_measured)
{
    struct {
        const char *name;
        Hidden hidden;
        double value;
    } rows[] = {{"quadratic-drag", {}, 0.012},
                {"deadband", {}, 0.25},
                {"input-delay", {}, 0.0062},
                {"end-stop", {}, 0.6}};
    rows[0].hidden.drag = 0.012;
    rows[1].hidden.dead = 0.25;
    rows[2].hidden.delay = 0.0062;
    rows[3].hidden.bumper = true;
    mk_explanation e = explained(rows[_i].hidden);
    ck_assert_msg(e.verdict == MK_VERDICT_EFFECT, "%s: %s %s", rows[_i].name,
                  mk_verdict_name(e.verdict), e.structure);
    ck_assert_msg(named(e, rows[_i].name), "%s was called %s", rows[_i].name,
                  e.cause[0].effect->name);
    if (strcmp(e.cause[0].effect->name, rows[_i].name) == 0)
        ck_assert_double_eq_tol(e.cause[0].value[0], rows[_i].value, 0.05 * rows[_i].value);
    ck_assert_double_gt(e.closed, 0.9);
}
END_TEST

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
    ck_assert_double_lt(e.noise[0], 0.5 * 2.0 * M_PI / 4000.0);
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

// The windows that are searched of logs of some lengths, in s, with another one to measure on.
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

START_TEST(tilt_and_encoder_offset_are_declared_inseparable)
{
    Hidden h;
    h.tilt = 0.02;
    mk_explanation e = explained(h);
    ck_assert_int_eq(e.verdict, MK_VERDICT_EFFECT);
    ck_assert(named(e, "base-tilt"));
    ck_assert(named(e, "encoder-offset"));
}
END_TEST

START_TEST(lost_pulses_are_found)
{
    Hidden h;
    h.missed_count = 20.0 * 2.0 * M_PI / 4000.0;
    mk_explanation e = explained(h);
    ck_assert_int_eq(e.verdict, MK_VERDICT_EFFECT);
    ck_assert_str_eq(e.cause[0].effect->name, "missed-counts");
    ck_assert_double_eq_tol(e.cause[0].value[0], h.missed_count, 2.0 * M_PI / 4000.0);
}
END_TEST

// Fast motion with steps of a few counts, one of them beside a missing row.
START_TEST(small_steps_of_a_fast_reading_are_lost_pulses)
{
    constexpr double COUNT = 2.0 * M_PI / 2048.0, STEP = 6.3 * COUNT;
    mk::FitLog log = {};
    log.joints = 1;
    log.count[0] = COUNT;
    const size_t at[] = {300, 901, 1500};
    for (size_t k = 0; k < 2000; k++) {
        double t = 0.004 * (double)k, q = 4.0 * std::sin(7.0 * t) + std::sin(23.0 * t);
        q += (k >= at[0]) * STEP - (k >= at[1]) * STEP + (k >= at[2]) * STEP;
        log.t.push_back(t);
        log.q[0].push_back(k == at[1] + 1 ? (double)NAN : std::round(q / COUNT) * COUNT);
    }
    std::vector<mk::MissedCount> found = mk::find_missed_counts({&log}, 0);
    ck_assert_uint_eq(found.size(), 3);
    for (size_t i = 0; i < 3; i++) {
        ck_assert_uint_eq(found[i].row, at[i]);
        ck_assert_double_eq_tol(found[i].step, i == 1 ? -STEP : STEP, 1.5 * COUNT);
    }
}
END_TEST

// A light wheel whose torque steps: no parabola goes on beyond that.
START_TEST(lost_pulses_beside_missing_rows_are_found)
{
    constexpr double COUNT = 2.0 * M_PI / 4000.0, STEP = 20.0 * COUNT;
    for (int missing = -5; missing < 5; missing++) {
        mk::FitLog log;
        log.joints = 1;
        log.count[0] = COUNT;
        for (int k = 0; k < 400; k++) {
            double angle = 0.8 * std::sin(0.01 * k) + (k >= 200 ? STEP : 0.0);
            log.q[0].push_back(k == 200 + missing ? (double)NAN
                                                  : COUNT * std::round(angle / COUNT));
        }
        std::vector<mk::MissedCount> found = mk::find_missed_counts({&log}, 0);
        ck_assert_msg(found.size() == 1, "row %d missing: %zu found", missing, found.size());
        ck_assert_double_eq_tol(found[0].step, STEP, COUNT);
    }
}
END_TEST

START_TEST(steps_of_a_wheel_s_acceleration_are_no_lost_pulses)
{
    constexpr double COUNT = 2.0 * M_PI / 8192.0, DT = 0.005;
    mk::FitLog log = {};
    log.joints = 1;
    log.count[0] = COUNT;
    double q = 0.0, v = -80.0;
    for (size_t k = 0; k < 2400; k++) {
        constexpr int FINE = 50;
        log.t.push_back(DT * (double)k);
        log.q[0].push_back(std::round(q / COUNT) * COUNT);
        for (int i = 0; i < FINE; i++) {
            double t = DT * ((double)k + (double)i / FINE);
            double a = std::sin(2.0 * M_PI * 1.43 * t) > 0.0 ? 900.0 : -900.0;
            q += DT / FINE * v, v += DT / FINE * a;
        }
    }
    ck_assert_uint_eq(mk::find_missed_counts({&log}, 0).size(), 0);
}
END_TEST

START_TEST(a_cause_that_no_entry_names_is_unknown_and_gets_a_formula)
{
    Hidden h;
    h.cubic = 2e-3;
    mk_explanation e = explained(h);
    ck_assert_str_eq(mk_verdict_name(e.verdict), "unknown");
    ck_assert_msg(strstr(e.structure, "dq1^3") != nullptr, "%s", e.structure);
    ck_assert_double_gt(e.closed, 0.5);
}
END_TEST

START_TEST(shares_of_the_gap_add_up_to_what_is_closed)
{
    Hidden h;
    h.drag = 0.012;
    h.dead = 0.8;
    const mk_explanation e = explained(h);
    const mk_budget &b = e.budget;
    ck_assert_str_eq(mk_verdict_name(e.verdict), "effect");
    ck_assert_int_eq(b.item_count, 2);
    double sum = 0.0;
    for (int i = 0; i < b.item_count; i++) {
        ck_assert_double_le(b.item[i].low, b.item[i].share);
        ck_assert_double_ge(b.item[i].high, b.item[i].share);
        sum += b.item[i].share;
    }
    ck_assert_double_eq_tol(sum, b.closed, 1e-9);
    ck_assert_double_eq_tol(b.closed + b.rest, 1.0, 1e-9);
    ck_assert_double_gt(b.closed, 0.95);
    // The last line of the table is the extended model; what came before it is further off.
    ck_assert_double_eq_tol(b.item[1].rms[0], b.extended[0], 1e-9);
    ck_assert_double_gt(b.item[0].rms[0], 2.0 * b.extended[0]);
    ck_assert_double_gt(b.refit[0], b.item[0].rms[0]);
    ck_assert_int_eq(b.rest_joint, 0);
}
END_TEST

// What is left of a rig's causes is fitted to free runs before it is judged by them: a delay alone
// then closes more than half of what a dead zone alone does. Fitted to each next reading, with as
// much process noise as it lacks, it closed a third.
START_TEST(a_part_of_the_causes_is_judged_at_its_best)
{
    Hidden h;
    h.dead = 1.5;
    h.delay = 0.012;
    const mk_explanation e = explained(h);
    const mk_budget &b = e.budget;
    ck_assert_int_eq(b.item_count, 2);
    ck_assert_str_eq(e.cause[b.item[0].cause].effect->name, "deadband");
    ck_assert_double_gt(b.item[1].share, 0.5 * b.item[0].share);
}
END_TEST

START_TEST(no_share_of_the_gap_is_negative_or_beyond_what_is_closed)
{
    Hidden h; // three that hang together so much that a part of them predicts worse than none
    h.tilt = 0.2;
    h.delay = 0.012;
    h.drag = 0.03;
    const mk_explanation e = explained(h);
    const mk_budget &b = e.budget;
    ck_assert_int_gt(b.item_count, 1);
    double sum = 0.0;
    for (int i = 0; i < b.item_count; i++) {
        ck_assert_double_ge(b.item[i].share, 0.0);
        ck_assert_double_le(b.item[i].share, b.closed + 1e-9);
        sum += b.item[i].share;
    }
    ck_assert_double_eq_tol(sum, b.closed, 1e-9);
}
END_TEST

START_TEST(a_named_cause_beside_one_without_a_name_is_a_part)
{
    Hidden h;
    h.dead = 0.4;
    h.cubic = 0.03;
    const mk_explanation e = explained(pendulum(false), record(h, 0, 9.0), record(h, 1, 5.0));
    ck_assert_msg(e.verdict == MK_VERDICT_PARTIAL, "%s: %s", mk_verdict_name(e.verdict),
                  e.structure);
    ck_assert_int_eq(e.cause_count - e.piece_count, 1);
    ck_assert_str_eq(e.cause[0].effect->name, "deadband");
    ck_assert_double_eq_tol(e.cause[0].value[0], 0.4, 0.02);
    ck_assert_ptr_nonnull(std::strstr(e.structure, "dq1^3"));
    char name[160];
    for (int i = 0; i < e.budget.item_count; i++) {
        mk_budget_item_name(&e, &e.budget.item[i], name, sizeof name);
        ck_assert_ptr_nonnull(
            std::strstr(name, e.budget.item[i].cause == 0 ? "deadband" : "dq1^3"));
    }
}
END_TEST

START_TEST(only_what_is_put_up_by_hand_has_a_place_of_its_own_in_every_log)
{
    mk_model own, m = pendulum(true);
    ck_assert_int_eq(mk_model_add_effect(&m, "coulomb", 1, nullptr), MK_OK);
    ck_assert(!mk::with_own_place(m, own));
    ck_assert_int_eq(mk_model_add_effect(&m, "cable-stiffness", 1, nullptr), MK_OK);
    ck_assert(mk::with_own_place(m, own));
    const int rest = mk_effect_parameter_index(mk_effect_by_name("cable-stiffness"), "rest");
    ck_assert_double_gt(own.effect[1].spread[rest], 0.0);
    ck_assert_double_eq(own.effect[0].spread[0], 0.0);
}
END_TEST

START_TEST(the_reports_say_what_was_found)
{
    Hidden h;
    h.drag = 0.012;
    mk_explanation e = explained(h);
    mk_error err = MK_ERROR_INIT;
    const char *path = scratch("report.json"), *files[] = {"held.csv"};
    const char *learned[] = {"a.csv", "b<i>.csv"};
    const mk_origin origin = {"2026-01-02T03:04:05Z", "mechkit explain --model 'my m.ini'",
                              "my m.ini", learned, 2};
    e.origin = &origin;
    ck_assert_int_eq(mk_explanation_write_json(&e, path, files, 1, &err), MK_OK);
    cJSON *o = nullptr;
    ck_assert_int_eq(mk_json_read(path, &o, &err), MK_OK);
    ck_assert_str_eq(cJSON_GetObjectItem(o, "verdict")->valuestring, "effect");
    cJSON *cause = cJSON_GetArrayItem(cJSON_GetObjectItem(o, "causes"), 0);
    ck_assert_str_eq(cJSON_GetObjectItem(cause, "name")->valuestring, "quadratic-drag");
    ck_assert_int_eq(cJSON_GetObjectItem(cause, "joint")->valueint, 1);
    const mk_effect_words *words = mk_effect_in_words(e.cause[0].effect);
    ck_assert_str_eq(cJSON_GetObjectItem(cause, "title")->valuestring, words->title);
    ck_assert_str_eq(cJSON_GetObjectItem(cause, "what_to_do")->valuestring, words->remedy);
    const cJSON *stages = cJSON_GetObjectItem(o, "stage_seconds");
    ck_assert_int_eq(cJSON_GetArraySize(stages), e.stage_count);
    double all_stages = 0.0;
    for (const cJSON *stage = stages->child; stage; stage = stage->next)
        all_stages += stage->valuedouble;
    ck_assert_double_le(all_stages, 1.001 * e.seconds);
    ck_assert_double_gt(cJSON_GetObjectItem(stages, "search")->valuedouble, 0.0);
    const cJSON *from = cJSON_GetObjectItem(o, "origin");
    ck_assert_str_eq(cJSON_GetObjectItem(from, "date")->valuestring, origin.date);
    ck_assert_str_eq(cJSON_GetObjectItem(from, "command")->valuestring, origin.command);
    ck_assert_int_eq(strncmp(cJSON_GetObjectItem(from, "program")->valuestring, "mechkit ", 8), 0);
    ck_assert_int_eq(cJSON_GetArraySize(cJSON_GetObjectItem(from, "logs")), 2);
    for (const char *key :
         {"rivals", "suspects", "parameters", "holdout", "next_experiment", "seconds"})
        ck_assert_msg(cJSON_GetObjectItem(o, key) != nullptr, "%s", key);
    cJSON_Delete(o);
    mk_log *log = record(h, 1, 4.0);
    path = scratch("report.html");
    ck_assert_int_eq(mk_explanation_write_html(&e, path, log, &err), MK_OK);
    mk_log_free(log);
    // A phone is narrower than a table: it scrolls by itself, not the page.
    char *html = slurp_file(path);
    ck_assert_ptr_nonnull(strstr(html, "div{overflow-x:auto}"));
    ck_assert(strstr(html, origin.date) && strstr(html, "b&lt;i&gt;.csv"));
    ck_assert_ptr_nonnull(strstr(html, words->remedy));
    for (const char *at = html; (at = strstr(at, "<table>")) != nullptr; at++)
        ck_assert_int_eq(strncmp(at - 5, "<div>", 5), 0);
    free(html);
}
END_TEST

// Nothing is uncertain about how many cycles a turn: consumers want a number.
START_TEST(whole_numbers_have_no_standard_error)
{
    mk_explanation e = {};
    mk_error err = MK_ERROR_INIT;
    const char *path = scratch("whole.json");
    e.given = e.refit = e.extended = pendulum(true);
    e.verdict = MK_VERDICT_EFFECT;
    e.cause_count = 1;
    e.cause[0].effect = mk_effect_by_name("cogging");
    e.cause[0].joint = 1;
    for (int k = 0; k < e.cause[0].effect->parameter_count; k++) {
        const bool whole = e.cause[0].effect->parameter[k].fit == MK_FIT_INTEGER;
        e.cause[0].std_error[k] = whole ? (double)NAN : 0.5;
        e.cause[0].value[k] = 7.0;
    }
    ck_assert_int_eq(mk_explanation_write_json(&e, path, nullptr, 0, &err), MK_OK);
    cJSON *o = nullptr;
    ck_assert_int_eq(mk_json_read(path, &o, &err), MK_OK);
    cJSON *cause = cJSON_GetArrayItem(cJSON_GetObjectItem(o, "causes"), 0), *p = nullptr;
    int wholes = 0;
    cJSON_ArrayForEach(p, cJSON_GetObjectItem(cause, "parameters"))
    {
        const bool whole = cJSON_IsTrue(cJSON_GetObjectItem(p, "integer"));
        ck_assert_double_eq(cJSON_GetObjectItem(p, "stderr")->valuedouble, whole ? 0.0 : 0.5);
        ck_assert(cJSON_IsNumber(cJSON_GetObjectItem(p, "stderr")));
        wholes += whole;
    }
    ck_assert_int_eq(wholes, 1);
    cJSON_Delete(o);
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

START_TEST(a_formula_that_is_not_offered_is_not_said_to_explain_a_part)
{
    mk_explanation e = {};
    e.given = e.refit = e.extended = pendulum(true);
    e.verdict = MK_VERDICT_UNKNOWN;
    e.cause_count = 1;
    e.cause[0].effect = mk_effect_by_name("quadratic-drag");
    e.cause[0].joint = 1;
    e.partly_named = true;
    snprintf(e.structure, sizeof e.structure, "joint 1: -0.1*dq1*abs(dq1)");
    for (bool offered : {true, false}) {
        char *text = nullptr;
        size_t size = 0;
        e.offered = offered;
        FILE *out = open_memstream(&text, &size);
        explanation_print(out, &e);
        fclose(out);
        ck_assert_msg(!strstr(text, "explain a part") == !offered, "%s", text);
        ck_assert_msg(!strstr(text, "but not the held-out data") == offered, "%s", text);
        ck_assert_ptr_nonnull(strstr(text, "joint 1: 0 u rms"));
        free(text);
    }
}
END_TEST

// The wheel's command with its sign turned, say: what is learned from such a log predicts nothing.
START_TEST(logs_that_do_not_go_with_the_held_out_ones_are_doubted)
{
    mk_explanation e = {};
    e.given = e.refit = e.extended = pendulum(true);
    e.before[0] = 0.075;
    e.refitted[0] = e.after[0] = 0.35;
    e.floor[0] = 1e-4;
    for (bool doubts : {true, false}) {
        char *text = nullptr;
        size_t size = 0;
        FILE *out = open_memstream(&text, &size);
        explanation_print(out, &e);
        fclose(out);
        ck_assert_msg(!strstr(text, "same signs, units and columns?") != doubts, "%s", text);
        ck_assert(mk_explanation_doubts_logs(&e) == doubts);
        free(text);
        e.refitted[0] = 0.1;
    }
}
END_TEST

// The verdict `none` says nothing then.
START_TEST(readings_that_are_all_but_noise_are_said_to_be)
{
    mk_explanation e = {};
    e.given = e.refit = e.extended = pendulum(true);
    for (double floor : {0.9, 0.1}) {
        char *text = nullptr;
        size_t size = 0;
        FILE *out = open_memstream(&text, &size);
        e.floor[0] = floor;
        explanation_print(out, &e);
        fclose(out);
        ck_assert_msg(!strstr(text, "little can be seen in such data") == (floor < 0.5), "%s",
                      text);
        free(text);
    }
}
END_TEST

START_TEST(values_that_were_wrong_are_listed_with_those_of_given_effects)
{
    mk_explanation e = {};
    e.given = e.refit = e.extended = pendulum(true);
    e.verdict = MK_VERDICT_PARAMETERS;
    for (mk_model *m : {&e.given, &e.refit, &e.extended})
        ck_assert_int_eq(mk_model_add_effect(m, "quadratic-drag", 1, nullptr), MK_OK);
    e.given.effect[0].value[0] = 0.5;
    e.refit.effect[0].value[0] = e.extended.effect[0].value[0] = 0.25;
    e.refit.parameter[0] = 0.0625;
    e.std_error[0] = 0.001;
    e.std_error[1] = NAN;
    char *text = nullptr;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    explanation_print(out, &e);
    fclose(out);
    ck_assert_msg(strstr(text, "p1: given 0.0611, refitted 0.0625 +- 0.001\n") != nullptr, "%s",
                  text);
    ck_assert_ptr_nonnull(strstr(text, "quadratic-drag, coefficient: given 0.5, refitted 0.25\n"));
    free(text);
    mk_error err = MK_ERROR_INIT;
    mk_log *log = record({}, 1, 1.0);
    const char *path = scratch("values.html");
    ck_assert_int_eq(mk_explanation_write_html(&e, path, log, &err), MK_OK);
    mk_log_free(log);
    text = slurp_file(path);
    ck_assert_ptr_nonnull(strstr(text, "coefficient</td><td>0.5</td><td>0.25</td><td></td>"));
    ck_assert_ptr_null(strstr(text, "nan"));
    ck_assert_ptr_null(strstr(text, "with the cause"));
    ck_assert_ptr_nonnull(strstr(text, ">given</text>"));
    free(text);
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

// Before a search, too: where the report goes, and a hold-out that is none.
START_TEST(a_report_that_could_not_be_written_is_not_made)
{
    char out[1024], log[512] = "", folder[512], model[512];
    mk_error err = MK_ERROR_INIT;
    mk_model rig = pendulum(true);
    snprintf(model, sizeof model, "%s", scratch("rig.ini"));
    ck_assert_int_eq(mk_model_write(model, &rig, nullptr, &err), MK_OK);
    std::string text = "t,q1,u\n";
    for (int k = 0; k < 60; k++)
        text += std::to_string(0.01 * k) + ",0,0\n";
    snprintf(log, sizeof log, "%s", scratch_text("still.csv", text.c_str()));
    snprintf(folder, sizeof folder, "%s", scratch("explained"));
    auto explain = [&](const char *to, const char *below) {
        return run_mechkit(out, sizeof out, "explain --model %s --out %s%s --holdout %s %s %s",
                           model, to, below, log, log, log);
    };
    ck_assert_int_eq(explain(log, ""), 1);
    ck_assert_msg(strstr(out, "still.csv: this is no folder") != nullptr, "%s", out);
    ck_assert_int_eq(explain(folder, "/a/b"), 1);
    ck_assert_msg(strstr(out, "cannot make the folder") != nullptr, "%s", out);
    ck_assert_int_eq(explain(folder, ""), 3);
    ck_assert_msg(strstr(out, "which is learned from") != nullptr, "%s", out);
    ck_assert_msg(strstr(out, "they count twice") != nullptr, "%s", out);
    ck_assert_msg(strstr(out, "nothing moves") != nullptr, "%s", out);
    ck_assert_int_eq(count_files("explained"), 0);
}
END_TEST

START_TEST(a_report_is_written_whole_or_not_at_all)
{
    mk_explanation e = {};
    mk_error err = MK_ERROR_INIT;
    e.given = e.refit = e.extended = pendulum(true);
    mk_log *log = record({}, 1, 1.0);
    const char *held = "held.csv", *folder = scratch("reports"), *other = scratch("full");
    snprintf(e.next.input, sizeof e.next.input, "sin(t)");
    ck_assert_int_eq(explanation_write(folder, "m.ini", &e, &held, 1, log, &err), MK_OK);
    ck_assert_int_eq(count_files("reports/*"), 4);
    char *before = slurp_file(scratch("reports/extended.ini"));
    e.extended.parameter[0] *= 2.0;
    e.next.input[0] = 0;
    limit_file_size(1500); // report.html is longer, others are not
    const enum mk_status again = explanation_write(folder, "m.ini", &e, &held, 1, log, &err);
    const enum mk_status first = explanation_write(other, "m.ini", &e, &held, 1, log, nullptr);
    limit_file_size(0);
    ck_assert_int_eq(again, MK_ERR_NOSPACE);
    ck_assert_int_eq(first, MK_ERR_NOSPACE);
    ck_assert_str_eq(err.file, scratch("reports/report.html"));
    ck_assert_int_eq(count_files("full"), 0);
    ck_assert_int_eq(count_files("reports/*"), 4);
    ck_assert_int_eq(count_files("reports/.report*"), 0);
    char *after = slurp_file(scratch("reports/extended.ini"));
    ck_assert_str_eq(after, before);
    free(after);
    // What the earlier report proposed is not of this one.
    ck_assert_int_eq(explanation_write(folder, "m.ini", &e, &held, 1, log, &err), MK_OK);
    ck_assert_int_eq(count_files("reports/*"), 3);
    after = slurp_file(scratch("reports/extended.ini"));
    ck_assert_str_ne(after, before);
    free(after);
    free(before);
    mk_log_free(log);
}
END_TEST

START_TEST(a_search_that_is_ended_leaves_no_folder)
{
    char model[512], log[512], out[1024];
    mk_error err = MK_ERROR_INIT;
    const mk_model rig = pendulum(false);
    Hidden h;
    h.cubic = 2e-3;
    mk_log *data = record(h, 0, 12.0);
    snprintf(model, sizeof model, "%s", scratch("rig.ini"));
    snprintf(log, sizeof log, "%s", scratch("long.csv"));
    ck_assert_int_eq(mk_model_write(model, &rig, nullptr, &err), MK_OK);
    ck_assert_int_eq(mk_log_write(log, data, &err), MK_OK);
    mk_log_free(data);
    for (bool there : {false, true}) {
        const char *folder = scratch("ended");
        if (there)
            ck_assert_int_eq(run_command(nullptr, 0, "mkdir %s", folder), 0);
        int code =
            run_command(out, sizeof out, "timeout -s INT 0.2 %s explain --model %s --out %s %s",
                        MK_TEST_APP, model, folder, log);
        ck_assert_msg(code == 124, "%d %s", code, out);
        ck_assert_int_eq(count_files("ended"), there);
    }
}
END_TEST

// Before a search or a fit: what cannot be is refused, what is likely and what the metadata
// contradict is said.
START_TEST(one_law_has_one_name_at_every_joint)
{
    // Cogging once a revolution and an imbalance are the same torque at some joints.
    const auto plant = (enum mk_plant_kind)_i;
    mk_model bare;
    mk_model_default(plant, &bare);
    mk::DataRange range = {};
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        range.q_min[j] = -2.0, range.q_max[j] = 2.0, range.v_max[j] = 10.0;
    range.u_max = 1.0, range.seconds = 10.0, range.torque = 0.5;
    std::vector<mk::Candidate> waves, weights;
    for (const mk::Candidate &c : mk::candidates(bare, range)) {
        if (std::strcmp(c.effect->name, "cogging") == 0 && c.value[1] == 1.0)
            waves.push_back(c);
        if (std::strcmp(c.effect->name, "imbalance") == 0)
            weights.push_back(c);
    }
    ck_assert_uint_gt(weights.size(), 0);
    for (mk::Candidate wave : waves)
        for (mk::Candidate weight : weights) {
            if (wave.joint != weight.joint)
                continue;
            mk_model one, other;
            wave.value[0] = weight.value[0] = 0.1;
            wave.value[2] = -0.4, weight.value[1] = 0.4;
            ck_assert(mk::with_candidate(bare, wave, one));
            ck_assert(mk::with_candidate(bare, weight, other));
            double apart = 0.0;
            for (int k = 0; k < 5; k++) {
                const double x[4] = {0.3 + 0.5 * k, -0.7 * k, 1.0 - 0.3 * k, 0.2 * k}, u[2] = {0.1};
                double a[4], b[4];
                mk_model_rhs(&one, 0.0, x, u, a);
                mk_model_rhs(&other, 0.0, x, u, b);
                for (int i = 0; i < mk_model_state_count(&bare); i++)
                    apart = std::max(apart, std::fabs(a[i] - b[i]));
            }
            ck_assert_msg(apart > 1e-3, "%s at joint %d", mk_plant(plant)->name, wave.joint);
        }
}
END_TEST

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
        {0, 0, 1, 1, "encoder_cpr", "1e300", false, nullptr},
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

START_TEST(a_fit_writes_over_no_log_and_says_first_what_it_cannot_write)
{
    char out[2048], model[512], log[512];
    mk_error err = MK_ERROR_INIT;
    const mk_model rig = pendulum(false);
    mk_log *data = record({}, 0, 3.0);
    snprintf(model, sizeof model, "%s", scratch("rig.ini"));
    snprintf(log, sizeof log, "%s", scratch("run.csv"));
    ck_assert_int_eq(mk_model_write(model, &rig, nullptr, &err), MK_OK);
    ck_assert_int_eq(mk_log_write(log, data, &err), MK_OK);
    mk_log_free(data);
    char *before = slurp_file(log);
    auto identify = [&](const char *option, const char *to, const char *more) {
        return run_mechkit(out, sizeof out, "identify --method olsen --model %s %s %s %s %s", model,
                           option, to, more, log);
    };
    ck_assert_int_eq(identify("--out", log, ""), 2);
    ck_assert_int_eq(identify("--json", log, ""), 2);
    ck_assert_int_eq(identify("--json", model, ""), 2);
    ck_assert_msg(strstr(out, "that is a file to be read") != nullptr, "%s", out);
    char *after = slurp_file(log);
    ck_assert_str_eq(after, before);
    ck_assert_int_eq(identify("--out", scratch("no/where.ini"), ""), 1);
    ck_assert_msg(strstr(out, "where.ini: cannot write") && !strstr(out, "readings"), "%s", out);
    ck_assert_int_eq(identify("--json", "/dev/null", "--out /dev/null"), 0);
    ck_assert_int_eq(identify("--out", model, ""), 0);
    run_command(nullptr, 0, "truncate -s -3 %s", log);
    ck_assert_int_eq(identify("--out", scratch("fitted.ini"), ""), 0);
    ck_assert_msg(strstr(out, "the last line is incomplete") != nullptr, "%s", out);
    ck_assert_int_eq(count_files("*.tmp"), 0);
    free(before);
    free(after);
}
END_TEST

Suite *suite_explain(void)
{
    Suite *s = suite_create("explain");
    TCase *t = tcase_create("hidden effects");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, a_right_model_raises_no_alarm);
    tcase_add_test(t, wrong_values_are_told_from_missing_physics);
    tcase_add_test(t, values_are_called_wrong_where_one_data_set_in_ten_thousand_would_say_so);
    tcase_add_test(t, samples_that_came_late_are_taken_for_when_they_came);
    tcase_add_test(t, samples_by_the_boards_clock_are_not_moved);
    tcase_add_loop_test(t, of_several_long_logs_a_part_of_each_is_searched, 0, 4);
    tcase_add_test(t, with_more_logs_than_windows_those_are_spread_over_them);
    tcase_add_test(t, small_steps_of_a_fast_reading_are_lost_pulses);
    tcase_add_test(t, lost_pulses_beside_missing_rows_are_found);
    tcase_add_test(t, steps_of_a_wheel_s_acceleration_are_no_lost_pulses);
    tcase_add_test(t, a_cause_that_no_entry_names_is_unknown_and_gets_a_formula);
    tcase_add_test(t, only_what_is_put_up_by_hand_has_a_place_of_its_own_in_every_log);
    tcase_add_test(t, the_reports_say_what_was_found);
    tcase_add_test(t, whole_numbers_have_no_standard_error);
    tcase_add_test(t, of_a_log_that_ends_at_rest_the_end_of_its_motion_is_held_back);
    tcase_add_test(t, a_formula_that_is_not_offered_is_not_said_to_explain_a_part);
    tcase_add_test(t, logs_that_do_not_go_with_the_held_out_ones_are_doubted);
    tcase_add_test(t, readings_that_are_all_but_noise_are_said_to_be);
    tcase_add_test(t, values_that_were_wrong_are_listed_with_those_of_given_effects);
    tcase_add_test(t, a_log_without_motion_is_refused);
    tcase_add_loop_test(t, a_log_that_tells_nothing_is_refused_at_once, 0, 18);
    tcase_add_test(t, a_report_that_could_not_be_written_is_not_made);
    tcase_add_test(t, a_report_is_written_whole_or_not_at_all);
    tcase_add_test(t, a_search_that_is_ended_leaves_no_folder);
    tcase_add_test(t, a_fit_writes_over_no_log_and_says_first_what_it_cannot_write);
    tcase_add_loop_test(t, one_law_has_one_name_at_every_joint, 0, MK_PLANT_COUNT);
    tcase_add_loop_test(t, what_is_wrong_with_a_log_is_said_first, 0, 16);
    suite_add_tcase(s, t);

    t = tcase_create("more hidden effects");
    tcase_set_timeout(t, 120);
    tcase_set_tags(t, "long");
    tcase_add_test(t, upright_runs_of_the_exact_model_raise_no_doubt);
    tcase_add_test(t, one_step_predictions_of_a_right_model_leave_white_noise);
    tcase_add_test(t, a_long_hole_in_a_log_is_not_bridged);
    tcase_add_test(t, of_long_records_a_part_is_searched_and_said);
    tcase_add_test(t, parameters_come_of_all_data_though_a_part_is_searched);
    tcase_add_test(t, lost_pulses_are_found);
    tcase_add_test(t, tilt_and_encoder_offset_are_declared_inseparable);
    tcase_add_test(t, shares_of_the_gap_add_up_to_what_is_closed);
    tcase_add_test(t, a_part_of_the_causes_is_judged_at_its_best);
    tcase_add_test(t, no_share_of_the_gap_is_negative_or_beyond_what_is_closed);
    tcase_add_test(t, a_named_cause_beside_one_without_a_name_is_a_part);
    tcase_add_loop_test(t, a_hidden_effect_is_named_and_measured, 0, 4);
    suite_add_tcase(s, t);
    return s;
}

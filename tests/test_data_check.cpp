// Data checks: one list of findings, what is fatal ends a run, still and short logs are left out.
#include "suites.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "mechkit/data_check.h"
#include "mechkit/explain.h"
#include "mechkit/ident.h"
#include "mechkit/sim.h"
#include "support/cases.hpp"
#include "support/files.h"
#include "support/program.h"

namespace
{

using Log = std::unique_ptr<mk_log, decltype(&mk_log_free)>;

constexpr double RATE = 250.0; // Hz

mk_model model_of(enum mk_plant_kind kind)
{
    mk_model m;
    mk_model_default(kind, &m);
    return m;
}

// Of row k, -1 to 1, as random as it need be.
double random_of(size_t k)
{
    return std::remainder(0.6180339887 * (double)(k * k % 1009), 1.0) * 2.0;
}

// A motion of the model under sums of sines, one for each of its motors, read by its encoders.
// Times are off even steps by up to `uneven` of one.
Log record(const mk_model &m, double seconds, int motors = 1, double uneven = 0.0)
{
    const size_t rows = (size_t)(seconds * RATE);
    mk_log *made = nullptr;
    ck_assert_int_eq(mk_log_create(rows, &made), MK_OK);
    Log log(made, mk_log_free);
    double *t = mk_log_add_column(made, "t");
    double *u = mk_log_add_column(made, motors > 1 ? "u1" : "u");
    double *second = motors > 1 ? mk_log_add_column(made, "u2") : nullptr;
    for (size_t k = 0; k < rows; k++) {
        t[k] = ((double)k + uneven * random_of(k)) / RATE;
        u[k] = m.u_max * (0.3 * std::sin(5.0 * t[k]) + 0.2 * std::sin(13.0 * t[k]));
        if (second)
            second[k] = std::sin(4.0 * t[k]) + 0.5 * std::sin(11.0 * t[k]);
    }
    for (int j = 0; j < mk_model_joints(&m); j++) {
        double *q = mk_log_add_column(made, j ? "q2" : "q1");
        std::fill(q, q + rows, mk_plant(m.plant)->rest[j]);
    }
    mk_predict_options o = {};
    mk_predict_figures figures;
    mk_log *out = nullptr;
    ck_assert_int_eq(mk_predict(&m, made, &o, &out, &figures, nullptr, nullptr), MK_OK);
    for (int j = 0; j < mk_model_joints(&m); j++) {
        const char *name = j ? "q2" : "q1";
        const double count = mk_model_count(&m, j), *from = mk_log_get(out, name);
        for (size_t k = 0; k < rows; k++)
            const_cast<double *>(mk_log_get(made, name))[k] = std::round(from[k] / count) * count;
    }
    mk_log_free(out);
    return log;
}

double *column(const Log &log, const char *name)
{
    return const_cast<double *>(mk_log_get(log.get(), name));
}

void scale(const Log &log, const char *name, double by)
{
    for (size_t k = 0; k < log->rows; k++)
        column(log, name)[k] *= by;
}

std::unique_ptr<mk_data_check> check_of(const mk_model &m, const Log &log,
                                        enum mk_data_use use = MK_DATA_IDENTIFY)
{
    auto check = std::make_unique<mk_data_check>();
    mk_error err = MK_ERROR_INIT;
    const mk_log *logs[] = {log.get()};
    ck_assert_msg(mk_data_check_logs(&m, logs, 1, use, 1, check.get(), &err) == MK_OK, "%s",
                  err.message);
    return check;
}

bool says(const mk_data_check &check, const char *what)
{
    for (int i = 0; i < check.count; i++)
        if (strstr(check.finding[i].what, what) || strstr(check.finding[i].remedy, what))
            return true;
    return false;
}

} // namespace

START_TEST(a_good_log_has_no_findings)
{
    const mk_model m = model_of((enum mk_plant_kind)_i);
    const auto check = check_of(m, record(m, 6.0), MK_DATA_EXPLAIN);
    ck_assert_msg(check->count == 0, "%s: %s", mk_plant(m.plant)->name, check->finding[0].what);
}
END_TEST

// With the joints swapped the model's own speeds are nonsense, so that constant speeds are far off,
// and its predictions seem good beside those.
START_TEST(a_good_log_of_a_model_that_is_off_is_not_taken_for_one_with_swapped_joints)
{
    truth::Wish wish;
    wish.kind = "single", wish.seed = 150472;
    const truth::Case c = truth::make_case(wish);
    const mk_log *log = c.holdout.get();
    auto check = std::make_unique<mk_data_check>();
    *check = {};
    ck_assert_int_eq(
        mk_data_check_logs(&c.given, &log, 1, MK_DATA_HOLD_OUT, 2, check.get(), nullptr), MK_OK);
    const mk_data_finding *fatal = mk_data_check_fatal(check.get());
    ck_assert_msg(!fatal, "%s", fatal ? fatal->what : "");
}
END_TEST

START_TEST(a_flipped_command_and_swapped_joints_are_fatal_on_every_plant)
{
    const mk_model m = model_of((enum mk_plant_kind)_i);
    const Log flipped = record(m, 6.0);
    scale(flipped, "u", -1.0);
    const auto check = check_of(m, flipped);
    const mk_data_finding *fatal = mk_data_check_fatal(check.get());
    ck_assert_msg(fatal != nullptr, "%s", mk_plant(m.plant)->name);
    ck_assert_msg(strstr(fatal->remedy, "sign = -1") != nullptr, "%s", fatal->remedy);
    if (mk_model_joints(&m) < 2)
        return;
    const Log swapped = record(m, 6.0);
    std::swap_ranges(column(swapped, "q1"), column(swapped, "q1") + swapped->rows,
                     column(swapped, "q2"));
    ck_assert_msg(mk_data_check_fatal(check_of(m, swapped).get()) != nullptr, "%s",
                  mk_plant(m.plant)->name);
}
END_TEST

// A rig with two motors, and a model of it that misses a good part of what it does.
START_TEST(the_wrong_sign_of_one_motor_or_of_both_is_named)
{
    struct {
        bool first, second;
    } const wrong[] = {{false, false}, {true, false}, {false, true}, {true, true}};
    const mk_model rig = model_of(MK_PLANT_PENDUBOT);
    mk_model given = rig;
    given.parameter[5] *= 0.3; // friction
    given.parameter[6] *= 0.3;
    given.parameter[3] *= 1.1;
    for (const auto &w : wrong) {
        const Log log = record(rig, 6.0, 2);
        scale(log, "u1", w.first ? -1.0 : 1.0);
        scale(log, "u2", w.second ? -1.0 : 1.0);
        const auto check = check_of(given, log);
        const mk_data_finding *fatal = mk_data_check_fatal(check.get());
        ck_assert_int_eq(fatal != nullptr, w.first || w.second);
        if (!fatal)
            continue;
        const bool first = strstr(fatal->remedy, "[u1] sign = -1") != nullptr;
        const bool second = strstr(fatal->remedy, "[u2] sign = -1") != nullptr;
        ck_assert_msg(first == w.first && second == w.second, "%d %d: %s", w.first, w.second,
                      fatal->remedy);
    }
}
END_TEST

START_TEST(a_sent_command_that_runs_against_the_measured_one_is_doubted)
{
    const mk_model m = model_of(MK_PLANT_PENDULUM);
    const Log log = record(m, 6.0);
    double *sent = mk_log_add_column(log.get(), "u_cmd");
    std::copy_n(column(log, "u"), log->rows, sent);
    ck_assert_int_eq(check_of(m, log)->count, 0);
    scale(log, "u_cmd", -1.0);
    ck_assert(says(*check_of(m, log), "u_cmd runs against u"));
}
END_TEST

// A library user meets the same as a user of the program: nothing is fitted to data of a wrong sign
// unless that is asked for, and then the result says so.
START_TEST(a_fatal_finding_ends_a_fit_and_forced_it_goes_with_the_result)
{
    const mk_model m = model_of(MK_PLANT_PENDULUM);
    const Log log = record(m, 6.0);
    scale(log, "u", -1.0);
    const mk_log *logs[] = {log.get()};
    auto r = std::make_unique<mk_ident_result>();
    mk_error err = MK_ERROR_INIT;
    mk_ident_options o = {};
    o.method = "sls";
    ck_assert_int_eq(mk_identify(&m, logs, 1, &o, r.get(), &err), MK_ERR_EXPECT);
    ck_assert_msg(strstr(err.message, "[u] sign = -1") != nullptr, "%s", err.message);
    auto e = std::make_unique<mk_explanation>();
    ck_assert_int_eq(mk_explain(&m, logs, 1, nullptr, 0, nullptr, e.get(), &err), MK_ERR_EXPECT);
    o.method = "output-error";
    o.force = true;
    const Log other = record(m, 6.0);
    scale(other, "q1", 180.0 / M_PI);
    logs[0] = other.get();
    if (mk_identify(&m, logs, 1, &o, r.get(), &err) == MK_OK)
        ck_assert(mk_data_check_fatal(&r->data_check) != nullptr);
}
END_TEST

START_TEST(a_still_log_among_several_is_left_out)
{
    const mk_model m = model_of(MK_PLANT_PENDULUM);
    const Log good = record(m, 4.0), still = record(m, 4.0);
    scale(still, "q1", 0.0);
    const mk_log *logs[] = {still.get(), good.get()}, *none[] = {still.get(), still.get()};
    auto r = std::make_unique<mk_ident_result>(), alone = std::make_unique<mk_ident_result>();
    mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_identify(&m, logs, 2, nullptr, r.get(), &err) == MK_OK, "%s", err.message);
    ck_assert(says(r->data_check, "nothing moves in this log, and it is left out"));
    ck_assert_int_eq(mk_identify(&m, logs + 1, 1, nullptr, alone.get(), &err), MK_OK);
    ck_assert_uint_eq(r->rows, alone->rows);
    ck_assert_double_eq(r->parameter[0].value, alone->parameter[0].value);
    ck_assert_int_eq(mk_identify(&m, none, 2, nullptr, r.get(), &err), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "nothing moves"));
    auto check = std::make_unique<mk_data_check>();
    ck_assert_int_eq(mk_data_check_logs(&m, logs, 2, MK_DATA_EXPLAIN, 1, check.get(), &err), MK_OK);
    ck_assert(!mk_data_check_uses(&m, logs[0], MK_DATA_EXPLAIN));
    ck_assert(mk_data_check_uses(&m, logs[1], MK_DATA_EXPLAIN));
}
END_TEST

// Long logs take longer to check than short ones: on several threads they are not done in order.
START_TEST(findings_are_in_the_order_of_the_logs_on_any_number_of_threads)
{
    const mk_model m = model_of(MK_PLANT_PENDULUM);
    const Log turned = record(m, 12.0), brief = record(m, 0.2), still = record(m, 2.0),
              good = record(m, 4.0);
    scale(turned, "u", -1.0);
    scale(still, "q1", 0.0);
    const mk_log *logs[] = {good.get(), turned.get(), brief.get(), still.get()};
    mk_data_check expected = {};
    for (const mk_log *one : logs) {
        auto alone = std::make_unique<mk_data_check>();
        (void)!mk_data_check_logs(&m, &one, 1, MK_DATA_IDENTIFY, 1, alone.get(), nullptr);
        // The wrong sign is fatal, and comes first.
        for (int i = 0; i < alone->count; i++)
            expected.finding[expected.count++] = alone->finding[i];
    }
    ck_assert_int_ge(expected.count, 3);
    for (int threads = 0; threads <= 4; threads++) {
        auto check = std::make_unique<mk_data_check>();
        ck_assert_int_eq(
            mk_data_check_logs(&m, logs, 4, MK_DATA_IDENTIFY, threads, check.get(), nullptr),
            MK_OK);
        ck_assert_int_eq(check->count, expected.count);
        for (int i = 0; i < check->count; i++)
            ck_assert_str_eq(check->finding[i].what, expected.finding[i].what);
    }
}
END_TEST

START_TEST(two_tenths_of_a_second_explain_nothing)
{
    const mk_model m = model_of(MK_PLANT_PENDULUM);
    const Log brief = record(m, 0.2), good = record(m, 4.0);
    const mk_log *logs[] = {brief.get()}, *enough[] = {good.get()};
    auto e = std::make_unique<mk_explanation>();
    mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_explain(&m, logs, 1, enough, 1, nullptr, e.get(), &err), MK_ERR_RANGE);
    ck_assert_msg(strstr(err.message, "s of data explain nothing: a swing about hanging takes") &&
                      strstr(err.message, "Record "),
                  "%s", err.message);
    ck_assert(says(*check_of(m, brief), "say little: a swing about hanging takes"));
    // Fifty milliseconds say nothing of a gain.
    const Log flash = record(m, 0.2);
    for (size_t k = 0; k < flash->rows; k++)
        column(flash, "t")[k] *= 0.25;
    const mk_log *held[] = {flash.get()};
    ck_assert_int_eq(mk_explain(&m, enough, 1, held, 1, nullptr, e.get(), &err), MK_ERR_RANGE);
    ck_assert_msg(strstr(err.message, "too short to measure a gain on") != nullptr, "%s",
                  err.message);
    ck_assert(!mk_data_check_uses(&m, held[0], MK_DATA_HOLD_OUT));
}
END_TEST

START_TEST(thinned_logs_and_rounded_times_are_named)
{
    const mk_model m = model_of(MK_PLANT_PENDULUM);
    const Log thinned = record(m, 4.0);
    ck_assert_int_eq(mk_log_set_meta(thinned.get(), "sample_rate_hz", "1000"), MK_OK);
    ck_assert(says(*check_of(m, thinned), "thinned: its rows, 0.004 s apart, are one in 4"));
    const Log counted = record(m, 4.0);
    double *tick = mk_log_add_column(counted.get(), "tick");
    for (size_t k = 0; k < counted->rows; k++)
        tick[k] = 5.0 * (double)k;
    ck_assert(says(*check_of(m, counted), "are one in 5"));
    const Log rounded = record(m, 4.0);
    for (size_t k = 0; k < rounded->rows; k++)
        column(rounded, "t")[k] = 1e-3 * std::round(1e3 * 1.07 * column(rounded, "t")[k]);
    ck_assert(says(*check_of(m, rounded), "time stamps are rounded to 0.001 s"));
    // Dropped rows leave steps of whole periods, which is no rounding.
    const Log dropped = record(m, 4.0);
    for (size_t k = 0; k < dropped->rows; k++)
        column(dropped, "t")[k] = 0.004 * ((double)k + std::floor((double)k / 6.0));
    ck_assert(!says(*check_of(m, dropped), "rounded"));
}
END_TEST

// Rows that were taken evenly and stamped by another clock; one reading is off, which says nothing.
static Log stamped_late(const mk_model &m)
{
    Log log = record(m, 6.0);
    for (size_t k = 0; k < log->rows; k++)
        column(log, "t")[k] += 0.2 * random_of(k) / RATE;
    column(log, "q1")[700] += 0.3;
    return log;
}

START_TEST(times_that_scatter_where_the_readings_do_not_are_doubted_and_made_even)
{
    const mk_model m = model_of((enum mk_plant_kind)_i);
    const Log log = stamped_late(m);
    ck_assert(says(*check_of(m, log), "scatter by"));
    ck_assert(mk_data_take_even_times(&m, log.get()));
    for (size_t k = 0; k < log->rows; k++)
        ck_assert_double_eq_tol(column(log, "t")[k], (double)k / RATE, 5e-5);
    ck_assert(!says(*check_of(m, log), "scatter by"));
    ck_assert(!mk_data_take_even_times(&m, log.get()));
    // Of rows that were dropped, the others stay where they are.
    const Log fewer = stamped_late(m);
    for (size_t k = 0; k < fewer->rows; k++)
        column(fewer, "t")[k] += (double)(k / 500) * 7.0 / RATE;
    ck_assert(mk_data_take_even_times(&m, fewer.get()));
    for (size_t k = 0; k < fewer->rows; k++)
        ck_assert_double_eq_tol(column(fewer, "t")[k], (double)(k + 7 * (k / 500)) / RATE, 5e-5);
}
END_TEST

START_TEST(rows_that_come_more_than_half_a_step_late_keep_their_place_among_even_times)
{
    const mk_model m = model_of(MK_PLANT_PENDULUM);
    const Log log = stamped_late(m);
    for (size_t k = 97; k < log->rows; k += 97)
        column(log, "t")[k] += 0.55 / RATE;
    ck_assert(mk_data_take_even_times(&m, log.get()));
    for (size_t k = 0; k < log->rows; k++)
        ck_assert_double_eq_tol(column(log, "t")[k], (double)k / RATE, 1e-4);
    // A clock that was set while it ran is no scatter.
    const Log set = stamped_late(m);
    for (size_t k = 600; k < set->rows; k++)
        column(set, "t")[k] += 3.4 / RATE * std::sin((double)k / 300.0);
    const std::vector<double> before(column(set, "t"), column(set, "t") + set->rows);
    ck_assert(!mk_data_take_even_times(&m, set.get()));
    ck_assert(std::equal(before.begin(), before.end(), column(set, "t")));
}
END_TEST

START_TEST(times_at_which_a_rig_was_read_unevenly_are_kept)
{
    const mk_model m = model_of((enum mk_plant_kind)_i);
    const Log log = record(m, 6.0, 1, 0.2);
    ck_assert(!says(*check_of(m, log), "scatter by"));
    ck_assert(!mk_data_take_even_times(&m, log.get()));
}
END_TEST

START_TEST(identify_takes_even_times_unless_all_is_kept)
{
    char out[16384], model[512], log[512];
    const mk_model m = model_of(MK_PLANT_PENDULUM);
    const Log run = stamped_late(m);
    snprintf(model, sizeof model, "%s", scratch("rig.ini"));
    snprintf(log, sizeof log, "%s", scratch("late.csv"));
    ck_assert_int_eq(mk_model_write(model, &m, nullptr, nullptr), MK_OK);
    ck_assert_int_eq(mk_log_write(log, run.get(), nullptr), MK_OK);
    int code = run_mechkit(out, sizeof out, "identify --out %s --model %s %s", scratch("fit.ini"),
                           model, log);
    ck_assert_msg(code == 0 && strstr(out, "even times are taken (--keep-all"), "%d %s", code, out);
    code = run_mechkit(out, sizeof out, "identify --keep-all --out %s --model %s %s",
                       scratch("kept.ini"), model, log);
    ck_assert_msg(code == 0 && strstr(out, "scatter by") && !strstr(out, "even times are taken"),
                  "%d %s", code, out);
}
END_TEST

START_TEST(one_row_is_said_to_be_too_few)
{
    const mk_model m = model_of(MK_PLANT_PENDULUM);
    const Log log = record(m, 6.0);
    const mk_log *logs[] = {log.get()};
    auto check = std::make_unique<mk_data_check>();
    mk_error err = MK_ERROR_INIT;
    const size_t rows = log->rows;
    log->rows = 1;
    ck_assert_int_ne(mk_data_check_logs(&m, logs, 1, MK_DATA_IDENTIFY, 1, check.get(), &err),
                     MK_OK);
    log->rows = rows;
    ck_assert_msg(strstr(err.message, "1 row is too few to learn anything from") != nullptr, "%s",
                  err.message);
}
END_TEST

// A number of counts that cannot be is not taken for none given.
START_TEST(counts_that_cannot_be_are_doubted)
{
    static const char *const wrong[] = {"0", "-4000", "nan", "inf", "many", "1e9", "4000x"};
    const mk_model m = model_of(MK_PLANT_PENDULUM);
    const Log log = record(m, 6.0);
    for (const char *word : wrong) {
        ck_assert_int_eq(mk_log_set_meta(log.get(), "encoder_cpr", word), MK_OK);
        ck_assert_msg(says(*check_of(m, log), "is no number of counts a revolution"), "%s", word);
    }
    for (const char *word : {"4000", "", " 4000 "}) {
        ck_assert_int_eq(mk_log_set_meta(log.get(), "encoder_cpr", word), MK_OK);
        ck_assert_msg(!says(*check_of(m, log), "encoder_cpr"), "%s", word);
    }
    ck_assert_int_eq(mk_log_set_meta(log.get(), "encoder_resolution", "-1"), MK_OK);
    ck_assert(says(*check_of(m, log), "is no size of a count above 0"));
}
END_TEST

// Findings go to the head of the report, of its JSON and of the terminal.
START_TEST(what_is_doubted_heads_everything)
{
    char out[16384], model[512], log[512], folder[512];
    mk_model m = model_of(MK_PLANT_PENDULUM);
    const Log run = record(m, 6.0);
    scale(run, "u", -1.0);
    snprintf(model, sizeof model, "%s", scratch("rig.ini"));
    snprintf(log, sizeof log, "%s", scratch("flipped.csv"));
    snprintf(folder, sizeof folder, "%s", scratch("report"));
    ck_assert_int_eq(mk_model_write(model, &m, nullptr, nullptr), MK_OK);
    ck_assert_int_eq(mk_log_write(log, run.get(), nullptr), MK_OK);
    int code = run_mechkit(out, sizeof out, "explain --model %s --out %s %s", model, folder, log);
    ck_assert_msg(code == 1 && strstr(out, "fatal: ") && strstr(out, "--force"), "%d %s", code,
                  out);
    code =
        run_mechkit(out, sizeof out, "explain --force --model %s --out %s %s", model, folder, log);
    ck_assert_msg(code == 0, "%s", out);
    ck_assert_msg(strstr(out, "\nData check:\n  fatal: ") != nullptr, "%s", out);
    char *html = slurp_file(scratch("report/report.html"));
    char *json = slurp_file(scratch("report/report.json"));
    ck_assert(strstr(html, "Data check") && strstr(html, "Data check") < strstr(html, "<h1>"));
    ck_assert_ptr_nonnull(strstr(html, "[u] sign = -1"));
    const char *list = strstr(json, "\"data_checks\"");
    ck_assert(list && strstr(list, "\"severity\":") && strstr(list, "\"do\":"));
    ck_assert(list < strstr(json, "\"verdict\""));
    free(html);
    free(json);
}
END_TEST

// What explain says would have been seen is named at two and a half times that size, and not at a
// third of it.
START_TEST(what_would_have_been_seen_is_seen_from_there_on)
{
    static const struct {
        enum mk_plant_kind plant;
        const char *effect;
        int joint;
    } rows[] = {{MK_PLANT_PENDULUM, "quadratic-drag", 1},
                {MK_PLANT_PENDULUM, "gain-asymmetry", 0},
                {MK_PLANT_PENDUBOT, "coulomb", 2},
                {MK_PLANT_PENDUBOT, "viscous", 2},
                {MK_PLANT_REACTION_WHEEL, "coulomb", 1}};
    const auto &row = rows[_i];
    const mk_model m = model_of(row.plant);
    auto e = std::make_unique<mk_explanation>();
    mk_error err = MK_ERROR_INIT;
    const auto explain = [&](const mk_model &truth) {
        const Log log = record(truth, 8.0);
        const mk_log *logs[] = {log.get()};
        ck_assert_msg(mk_explain(&m, logs, 1, nullptr, 0, nullptr, e.get(), &err) == MK_OK, "%s",
                      err.message);
    };
    explain(m);
    double least = 0.0;
    int parameter = 0;
    for (int i = 0; i < e->detection_limit_count; i++)
        if (strcmp(e->detection_limit[i].effect->name, row.effect) == 0 &&
            e->detection_limit[i].joint == row.joint) {
            least = e->detection_limit[i].least;
            parameter = e->detection_limit[i].parameter;
        }
    ck_assert_msg(least > 0.0, "%s", row.effect);
    for (double times : {0.33, 2.5}) {
        mk_model truth = m;
        ck_assert_int_eq(mk_model_add_effect(&truth, row.effect, row.joint, nullptr), MK_OK);
        truth.effect[0].value[parameter] = times * least;
        explain(truth);
        ck_assert_msg((e->verdict == MK_VERDICT_EFFECT) == (times > 1.0), "%s, %g of %g: %s",
                      row.effect, times, least, mk_verdict_name(e->verdict));
    }
}
END_TEST

extern "C" Suite *suite_data_check(void)
{
    Suite *s = suite_create("data_check");
    TCase *t = tcase_create("all");
    tcase_set_timeout(t, 240);
    tcase_add_loop_test(t, a_good_log_has_no_findings, 0, MK_PLANT_COUNT);
    tcase_add_test(t, a_good_log_of_a_model_that_is_off_is_not_taken_for_one_with_swapped_joints);
    tcase_add_test(t, the_wrong_sign_of_one_motor_or_of_both_is_named);
    tcase_add_test(t, a_sent_command_that_runs_against_the_measured_one_is_doubted);
    tcase_add_loop_test(t, a_flipped_command_and_swapped_joints_are_fatal_on_every_plant, 0,
                        MK_PLANT_COUNT);
    tcase_add_test(t, a_still_log_among_several_is_left_out);
    tcase_add_test(t, findings_are_in_the_order_of_the_logs_on_any_number_of_threads);
    tcase_add_test(t, two_tenths_of_a_second_explain_nothing);
    tcase_add_test(t, thinned_logs_and_rounded_times_are_named);
    tcase_add_loop_test(t, times_that_scatter_where_the_readings_do_not_are_doubted_and_made_even,
                        0, MK_PLANT_COUNT);
    tcase_add_test(t, rows_that_come_more_than_half_a_step_late_keep_their_place_among_even_times);
    tcase_add_loop_test(t, times_at_which_a_rig_was_read_unevenly_are_kept, 0, MK_PLANT_COUNT);
    tcase_add_test(t, identify_takes_even_times_unless_all_is_kept);
    suite_add_tcase(s, t);
    t = tcase_create("searches");
    tcase_set_timeout(t, 240);
    tcase_set_tags(t, "long");
    tcase_add_test(t, a_fatal_finding_ends_a_fit_and_forced_it_goes_with_the_result);
    tcase_add_test(t, what_is_doubted_heads_everything);
    tcase_add_test(t, counts_that_cannot_be_are_doubted);
    tcase_add_test(t, one_row_is_said_to_be_too_few);
    tcase_add_loop_test(t, what_would_have_been_seen_is_seen_from_there_on, 0, 5);
    suite_add_tcase(s, t);
    return s;
}

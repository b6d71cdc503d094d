/* Identification: recovery by every linear method, stated errors, repeated runs; bad data by all.
 */
#include "suites.h"

#include <cmath>
#include <cstring>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "mechkit/ident.h"
#include "mechkit/json.h"
#include "mechkit/sim.h"
#include "support/files.h"
#include "support/program.h"

namespace
{

constexpr const char *METHODS[] = {"sls", "wls", "swevers", "olsen", "energy"};
constexpr const char *ALL_METHODS[] = {"output-error", "sls", "wls", "swevers", "olsen", "energy"};

struct FreeLog {
    void operator()(mk_log *log) const { mk_log_free(log); }
};
using Log = std::unique_ptr<mk_log, FreeLog>;
using Result = std::unique_ptr<mk_ident_result>;

struct Run {
    double amplitude = 1.5, seconds = 20, rate = 1000;
    double release = 0; /* q1 at the start, from rest, rad */
};

/* A log of the model under two sines; every reading exact. Columns t, u, q1, (q2). */
Log record(const mk_model &m, const Run &run)
{
    mk_log *log;
    mk_sim *sim;
    size_t rows = (size_t)(run.seconds * run.rate) + 1;
    int joints = mk_model_joints(&m);
    ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
    double *q[2] = {nullptr, nullptr};
    double *t = mk_log_add_column(log, "t"), *u = mk_log_add_column(log, "u");
    for (int j = 0; j < joints; j++)
        q[j] = mk_log_add_column(log, j ? "q2" : "q1");
    double still[2] = {0, 0}, x[MK_MAX_STATES], y[2];
    ck_assert_int_eq(mk_sim_create(&m, nullptr, &sim, nullptr), MK_OK);
    mk_model_initial_state(&m, mk_plant(m.plant)->rest, still, x);
    x[0] += run.release;
    ck_assert_int_eq(mk_sim_reset(sim, 0, x, nullptr), MK_OK);
    for (size_t k = 0; k < rows; k++) {
        t[k] = (double)k / run.rate;
        double command[2] = {run.amplitude * (sin(6 * t[k]) + 0.6 * sin(2.3 * t[k])), 0};
        mk_sim_measure(sim, y);
        u[k] = command[0];
        for (int j = 0; j < joints; j++)
            q[j][k] = y[j];
        ck_assert_int_eq(mk_sim_advance(sim, (double)(k + 1) / run.rate, command, nullptr), MK_OK);
    }
    mk_sim_destroy(sim);
    return Log(log);
}

double *column(const Log &log, const char *name)
{
    return const_cast<double *>(mk_log_get(log.get(), name));
}

Log with_noise(const mk_log &clean, double noise, unsigned seed)
{
    mk_log *log;
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0, noise);
    ck_assert_int_eq(mk_log_create(clean.rows, &log), MK_OK);
    for (size_t c = 0; c < clean.column_count; c++) {
        double *x = mk_log_add_column(log, clean.columns[c].name);
        bool angle = clean.columns[c].name[0] == 'q';
        for (size_t k = 0; k < clean.rows; k++)
            x[k] = clean.columns[c].data[k] + (angle ? normal(random) : 0.0);
    }
    return Log(log);
}

struct Fit {
    Result r = std::make_unique<mk_ident_result>();
    mk_error err = MK_ERROR_INIT;
    enum mk_status status;

    Fit(const mk_model &m, const std::vector<const mk_log *> &logs, const char *method,
        int hold = -1)
    {
        mk_ident_options o = {};
        o.method = method;
        o.force = true; // what the methods themselves make of data that a check refuses
        if (hold >= 0)
            o.fixed[hold] = true;
        status = mk_identify(&m, logs.data(), logs.size(), &o, r.get(), &err);
    }
    Fit(const mk_model &m, const Log &log, const char *method, int hold = -1)
        : Fit(m, std::vector<const mk_log *>{log.get()}, method, hold)
    {
    }
    bool warns(const char *text) const
    {
        for (int i = 0; i < r->warning_count; i++)
            if (strstr(r->warning[i], text))
                return true;
        return false;
    }
};

mk_model rig(enum mk_plant_kind kind)
{
    mk_model m;
    mk_model_default(kind, &m);
    return m;
}

START_TEST(every_method_finds_every_plants_parameters_on_exact_readings)
{
    for (int kind = 0; kind < MK_PLANT_COUNT; kind++) {
        mk_model truth = rig((enum mk_plant_kind)kind);
        Run run;
        if (truth.joint_linear[0]) {
            run.amplitude = 5.0;             // N: its pole is to swing
            truth.friction_sharpness = 50.0; // s/m: friction turns over several readings
        }
        mk_model start = truth;
        for (double &p : start.parameter)
            p *= 1.2;
        Log log = record(truth, run);
        for (const char *method : METHODS) {
            Fit f(start, log, method);
            // On exact readings its weights leave the pole's own equation alone, which has the
            // ratio of p2 and p3 only: it says so and gives no values.
            if (truth.joint_linear[0] && f.status == MK_ERR_RANGE && !strcmp(method, "swevers")) {
                ck_assert_ptr_nonnull(strstr(f.err.message, "cannot tell the parameters apart"));
                continue;
            }
            ck_assert_msg(f.status == MK_OK, "%s %s: %s", mk_plant(truth.plant)->name, method,
                          f.err.message);
            for (int i = 0; i < f.r->parameter_count; i++) {
                double off = f.r->parameter[i].value / truth.parameter[i] - 1.0;
                ck_assert_msg(fabs(off) < 0.005, "%s %s %s: off by %g %%",
                              mk_plant(truth.plant)->name, method, f.r->parameter[i].name,
                              100 * off);
            }
        }
    }
}
END_TEST

/* Noise as of a 4000-count encoder. Energy alone says little about single parameters here. */
START_TEST(stated_errors_are_those_of_repeated_noise)
{
    mk_model truth = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 10, run.rate = 200;
    Log clean = record(truth, run);
    const int draws = 25;
    for (const char *method : METHODS) {
        double square = 0, inside = 0, count = 0;
        for (unsigned d = 0; d < draws; d++) {
            Fit f(truth, with_noise(*clean, 4.5e-4, d), method);
            ck_assert_msg(f.status == MK_OK, "%s: %s", method, f.err.message);
            for (int i = 0; i < f.r->parameter_count; i++) {
                const mk_ident_parameter &p = f.r->parameter[i];
                double z = (p.value - truth.parameter[i]) / p.std_error;
                square += z * z, inside += fabs(z) < 1.96, count++;
            }
        }
        ck_assert_msg(square / count > 0.5 && square / count < 1.7, "%s: error / stated %g", method,
                      sqrt(square / count));
        ck_assert_msg(inside / count > 0.84, "%s: coverage %g", method, inside / count);
    }
}
END_TEST

START_TEST(repeats_are_averaged_and_the_errors_shrink_with_their_number)
{
    mk_model truth = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 10, run.rate = 200;
    Log clean = record(truth, run);
    std::vector<Log> logs;
    std::vector<const mk_log *> views;
    for (unsigned i = 0; i < 16; i++) {
        logs.push_back(with_noise(*clean, 4.5e-4, i));
        views.push_back(logs.back().get());
    }
    Fit one(truth, logs[0], "olsen"), all(truth, views, "olsen");
    ck_assert_int_eq(one.status, MK_OK);
    ck_assert_int_eq(all.status, MK_OK);
    ck_assert_uint_eq(all.r->rows, one.r->rows);
    for (int i = 0; i < one.r->parameter_count; i++) {
        double ratio = one.r->parameter[i].std_error / all.r->parameter[i].std_error;
        ck_assert_double_gt(ratio, 2.7);
        ck_assert_double_lt(ratio, 6.0);
    }
}
END_TEST

/* At rest nothing is stored but weight, and hanging not even a wrong angle changes that. */
START_TEST(a_start_from_rest_anchors_the_balance_of_energy)
{
    mk_model truth = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 10, run.rate = 200;
    Log log = with_noise(*record(truth, run), 4.5e-4, 3);
    Fit whole(truth, log, "energy");
    const size_t later = 100;
    for (size_t c = 0; c < log->column_count; c++)
        memmove(log->columns[c].data, log->columns[c].data + later,
                (log->rows - later) * sizeof(double));
    log->rows -= later;
    Fit moving(truth, log, "energy");
    ck_assert_int_eq(whole.status, MK_OK);
    ck_assert_int_eq(moving.status, MK_OK);
    ck_assert_double_gt(moving.r->parameter[0].std_error, 1.3 * whole.r->parameter[0].std_error);
}
END_TEST

START_TEST(different_runs_are_not_averaged)
{
    mk_model truth = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 5, run.rate = 200;
    Log one = record(truth, run);
    run.amplitude = 1.3;
    Log other = record(truth, run);
    Fit f(truth, {one.get(), other.get()}, "olsen"), alone(truth, one, "olsen");
    ck_assert_int_eq(f.status, MK_OK);
    ck_assert_uint_eq(f.r->rows, 2 * alone.r->rows);
}
END_TEST

START_TEST(a_held_parameter_stays_and_the_others_are_found)
{
    mk_model truth = rig(MK_PLANT_PENDUBOT);
    Log log = record(truth, Run());
    for (const char *method : METHODS) {
        Fit f(truth, log, method, 4);
        ck_assert_int_eq(f.status, MK_OK);
        ck_assert_double_eq(f.r->parameter[4].value, truth.parameter[4]);
        ck_assert(f.r->parameter[4].fixed);
        ck_assert_double_eq_tol(f.r->parameter[0].value / truth.parameter[0], 1.0, 0.005);
    }
}
END_TEST

START_TEST(a_wider_window_is_taken_when_asked_for)
{
    mk_model truth = rig(MK_PLANT_PENDUBOT);
    Log log = record(truth, Run());
    mk_ident_options o = {};
    o.method = "olsen";
    o.cutoff_hz = 1.0;
    const mk_log *view = log.get();
    Result wide = std::make_unique<mk_ident_result>();
    ck_assert_int_eq(mk_identify(&truth, &view, 1, &o, wide.get(), nullptr), MK_OK);
    ck_assert_uint_lt(wide->rows, Fit(truth, log, "olsen").r->rows / 2);
}
END_TEST

/* --- bad data --- */

START_TEST(a_log_without_motion_is_refused)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.amplitude = 0, run.seconds = 2;
    Log log = record(m, run);
    for (const char *method : ALL_METHODS) {
        Fit f(m, log, method);
        ck_assert_int_eq(f.status, MK_ERR_RANGE);
        ck_assert_ptr_nonnull(strstr(f.err.message, "moves"));
    }
}
END_TEST

START_TEST(a_stuck_joint_is_named)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 5;
    Log log = record(m, run);
    for (size_t k = 0; k < log->rows; k++)
        column(log, "q2")[k] = 0.0;
    for (const char *method : METHODS) {
        Fit f(m, log, method);
        ck_assert_int_eq(f.status, MK_ERR_RANGE);
        ck_assert_ptr_nonnull(strstr(f.err.message, "q2 does not move"));
    }
}
END_TEST

/* Without a command the equations hold for all multiples of the parameters. */
START_TEST(a_free_swing_takes_its_scale_from_a_held_parameter)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.amplitude = 0, run.seconds = 8, run.release = 1.0;
    Log log = record(m, run);
    for (const char *method : METHODS) {
        Fit f(m, log, method);
        ck_assert_msg(f.status == MK_OK, "%s", f.err.message);
        ck_assert(f.r->scale_free && f.r->parameter[0].value == m.parameter[0]);
    }
    Fit f(m, log, "olsen", 3);
    ck_assert_msg(f.status == MK_OK, "%s", f.err.message);
    ck_assert_double_eq_tol(f.r->parameter[0].value / m.parameter[0], 1.0, 0.02);
}
END_TEST

/* A wheel at constant speed: friction is one number, not two, and there is no inertia in it. */
START_TEST(a_constant_command_is_refused_or_its_errors_say_so)
{
    mk_model m = rig(MK_PLANT_INERTIA_WHEEL);
    Run run;
    run.amplitude = 0, run.seconds = 4;
    Log log = record(m, run);
    for (size_t k = 0; k < log->rows; k++) {
        column(log, "u")[k] = 2.0;
        column(log, "q1")[k] = 147.4 * column(log, "t")[k];
    }
    for (const char *method : ALL_METHODS) {
        Fit f(m, with_noise(*log, 4.5e-4, 1), method);
        if (f.status == MK_OK)
            ck_assert_msg(f.warns("say little about p1"), "%s", method);
        else
            ck_assert_uint_gt(strlen(f.err.message), 20);
    }
}
END_TEST

START_TEST(a_log_of_another_rig_is_refused_or_warned_of)
{
    mk_model furuta = rig(MK_PLANT_FURUTA), m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 5, run.rate = 200;
    Log log = record(furuta, run);
    for (const char *method : ALL_METHODS) {
        Fit f(m, log, method);
        ck_assert_msg(f.status != MK_OK || f.r->warning_count > 0, "%s", method);
    }
    ck_assert_int_eq(mk_log_set_meta(log.get(), "rig", "furuta"), MK_OK);
    Fit f(m, log, "olsen");
    ck_assert_int_eq(f.status, MK_ERR_PARSE);
    ck_assert_ptr_nonnull(strstr(f.err.message, "furuta"));
}
END_TEST

START_TEST(rows_without_readings_are_bridged_or_left_out)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Log log = record(m, Run());
    std::mt19937 random(1);
    std::uniform_real_distribution<double> uniform;
    for (size_t k = 0; k < log->rows; k++)
        if (uniform(random) < 0.05)
            column(log, "q1")[k] = column(log, "q2")[k] = column(log, "u")[k] = NAN;
    for (size_t k = 8000; k < 8400; k++)
        column(log, "q2")[k] = NAN;
    for (const char *method : METHODS) {
        Fit f(m, log, method);
        ck_assert_msg(f.status == MK_OK, "%s: %s", method, f.err.message);
        for (int i = 0; i < f.r->parameter_count; i++)
            ck_assert_msg(fabs(f.r->parameter[i].value / m.parameter[i] - 1.0) < 0.02, "%s p%d: %g",
                          method, i + 1, f.r->parameter[i].value);
    }
}
END_TEST

START_TEST(columns_of_nothing_and_infinite_values_are_named)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 2;
    for (const char *name : {"q1", "q2", "u"}) {
        Log log = record(m, run);
        column(log, name)[1000] = INFINITY;
        Fit infinite(m, log, "sls");
        ck_assert_int_eq(infinite.status, MK_ERR_RANGE);
        ck_assert_ptr_nonnull(strstr(infinite.err.message, "infinite"));
        for (size_t k = 0; k < log->rows; k++)
            column(log, name)[k] = NAN;
        Fit nothing(m, log, "sls");
        ck_assert_int_eq(nothing.status, MK_ERR_RANGE);
        ck_assert_ptr_nonnull(strstr(nothing.err.message, name[0] == 'u' ? "command" : name));
    }
}
END_TEST

// A first look takes 8000 rows: of the last log those that are left of them, however few.
START_TEST(logs_of_any_length_together_are_enough)
{
    mk_model m;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    const Log first = record(m, {1.5, 7.996, 1000}), second = record(m, {1.2, 4, 1000});
    ck_assert_uint_eq(first->rows, 7997);
    const mk_log *logs[] = {first.get(), second.get()};
    const Result r = std::make_unique<mk_ident_result>();
    mk_error err = {};
    ck_assert_msg(mk_identify(&m, logs, 2, nullptr, r.get(), &err) == MK_OK, "%s", err.message);
}
END_TEST

START_TEST(ten_rows_are_refused_and_forty_do_not_crash)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.rate = 200, run.seconds = 0.045;
    Log ten = record(m, run);
    run.seconds = 0.2;
    Log forty = record(m, run);
    for (const char *method : ALL_METHODS) {
        Fit f(m, ten, method);
        ck_assert_int_eq(f.status, MK_ERR_RANGE);
        ck_assert_ptr_nonnull(strstr(f.err.message, "too few"));
        Fit g(m, forty, method);
        ck_assert(g.status == MK_OK || strlen(g.err.message) > 20);
    }
    for (const char *method : METHODS) {
        Fit g(m, forty, method);
        ck_assert_int_eq(g.status, MK_ERR_RANGE);
        ck_assert_ptr_nonnull(strstr(g.err.message, "too few for windows"));
    }
}
END_TEST

START_TEST(time_in_milliseconds_is_refused)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 2, run.rate = 200;
    Log log = record(m, run);
    for (size_t k = 0; k < log->rows; k++)
        column(log, "t")[k] *= 1000;
    for (const char *method : ALL_METHODS) {
        Fit f(m, log, method);
        ck_assert_int_eq(f.status, MK_ERR_RANGE);
        ck_assert_ptr_nonnull(strstr(f.err.message, "t in seconds"));
    }
}
END_TEST

START_TEST(output_error_warns_of_a_stuck_joint)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 3, run.rate = 200;
    Log log = record(m, run);
    for (size_t k = 0; k < log->rows; k++)
        column(log, "q2")[k] = 0.0;
    Fit f(m, log, "output-error");
    ck_assert(f.status != MK_OK || f.warns("q2 does not move"));
}
END_TEST

START_TEST(output_error_refuses_a_command_of_the_wrong_sign)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 5, run.rate = 200;
    Log log = with_noise(*record(m, run), 4.5e-4, 1);
    for (size_t k = 0; k < log->rows; k++)
        column(log, "u")[k] *= -1.0;
    Fit f(m, log, "output-error");
    ck_assert_int_ne(f.status, MK_OK);
    ck_assert_ptr_nonnull(strstr(f.err.message, "signs"));
}
END_TEST

START_TEST(output_error_warns_of_swapped_columns_and_of_degrees)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 5, run.rate = 200;
    Log swapped = with_noise(*record(m, run), 4.5e-4, 1), degrees = with_noise(*swapped, 0, 1);
    for (size_t k = 0; k < swapped->rows; k++) {
        std::swap(column(swapped, "q1")[k], column(swapped, "q2")[k]);
        column(degrees, "q1")[k] *= 180 / M_PI, column(degrees, "q2")[k] *= 180 / M_PI;
    }
    for (const Log *log : {&swapped, &degrees}) {
        Fit f(m, *log, "output-error");
        ck_assert(f.status != MK_OK || f.warns("follow"));
    }
    Fit right(m, with_noise(*record(m, run), 4.5e-4, 1), "output-error");
    ck_assert_int_eq(right.status, MK_OK);
    ck_assert(!right.warns("follow"));
}
END_TEST

START_TEST(output_error_does_not_take_a_wrong_zero_for_noise)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 5, run.rate = 200;
    Log log = with_noise(*record(m, run), 4.5e-4, 1);
    for (size_t k = 0; k < log->rows; k++)
        column(log, "q1")[k] += 0.02;
    Fit f(m, log, "output-error");
    ck_assert(f.warns("follow"));
    ck_assert_double_lt(f.r->noise[0], 2 * 4.5e-4);
}
END_TEST

/* A pole that weighs nothing, where one was given: no friction, which may be nothing. */
START_TEST(output_error_warns_where_nothing_is_left_of_a_mass)
{
    mk_model rig_without = rig(MK_PLANT_CART_POLE), given = rig_without;
    given.friction_sharpness = rig_without.friction_sharpness = 50.0; // s/m
    for (int i : {1, 2})
        rig_without.parameter[i] *= 1e-6;
    rig_without.parameter[4] = 0.0;
    Run run;
    run.seconds = 10, run.rate = 200, run.amplitude = 5;
    for (const mk_model &truth : {given, rig_without}) {
        Fit f(given, with_noise(*record(truth, run), 4.5e-4, 2), "output-error");
        ck_assert_int_eq(f.status, MK_OK);
        ck_assert(f.warns("nothing is left of p2") == (truth.parameter[1] != given.parameter[1]));
        ck_assert(!f.warns("nothing is left of p5"));
    }
}
END_TEST

/* Rows first to last - 1 are not in the log, or without values, or without angles. */
enum class Hole { rows, values, angles };
Log with_hole(const mk_log &whole, size_t first, size_t last, Hole hole)
{
    mk_log *log;
    size_t left_out = hole == Hole::rows ? last - first : 0;
    ck_assert_int_eq(mk_log_create(whole.rows - left_out, &log), MK_OK);
    for (size_t c = 0; c < whole.column_count; c++) {
        double *x = mk_log_add_column(log, whole.columns[c].name);
        const double *from = whole.columns[c].data;
        std::copy(from, from + first, x);
        std::copy(from + last, from + whole.rows, x + last - left_out);
        const char name = whole.columns[c].name[0];
        bool kept = name == 't' || (name == 'u' && hole == Hole::angles);
        for (size_t k = first; left_out == 0 && k < last; k++)
            x[k] = kept ? from[k] : (double)NAN;
    }
    return Log(log);
}

START_TEST(output_error_cuts_out_a_hole_of_seconds)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 8, run.rate = 200;
    Log whole = with_noise(*record(m, run), 4.5e-4, 1);
    for (Hole hole : {Hole::rows, Hole::values, Hole::angles}) {
        Fit f(m, with_hole(*whole, 600, 1000, hole), "output-error");
        ck_assert_msg(f.status == MK_OK, "%s", f.err.message);
        ck_assert(f.warns("in 2 pieces"));
        ck_assert(!f.warns("follow"));
        for (int i = 0; i < 7; i++) {
            const mk_ident_parameter &p = f.r->parameter[i];
            ck_assert_double_lt(fabs(p.value - m.parameter[i]), 4 * p.std_error);
            ck_assert_double_lt(p.std_error, 1e-3 * m.parameter[i]);
        }
    }
}
END_TEST

START_TEST(a_motor_that_warms_does_not_start_cold_again_after_a_hole)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    ck_assert_int_eq(mk_model_add_effect(&m, "gain-drift", 0, nullptr), MK_OK);
    m.effect[0].value[0] = 0.3, m.effect[0].value[1] = 3.0;
    Run run;
    run.seconds = 8, run.rate = 200;
    Log whole = with_noise(*record(m, run), 4.5e-4, 1);
    Fit f(m, with_hole(*whole, 600, 1000, Hole::rows), "output-error");
    ck_assert(f.status == MK_OK && f.warns("in 2 pieces") && !f.warns("follow"));
    for (int i = 0; i < 9; i++) {
        const mk_ident_parameter &p = f.r->parameter[i];
        ck_assert_double_lt(fabs(p.value - mk_model_parameter(&m, i)), 4 * p.std_error);
    }
}
END_TEST

START_TEST(output_error_refuses_what_neither_follows_nor_tells)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 5, run.rate = 200;
    Log log = with_noise(*record(m, run), 4.5e-4, 1);
    for (size_t k = 0; k < log->rows; k++)
        column(log, "u")[k] *= -1;
    Fit f(m, log, "output-error");
    ck_assert_int_eq(f.status, MK_ERR_NUMERIC);
    ck_assert_ptr_nonnull(strstr(f.err.message, "signs"));
}
END_TEST

START_TEST(equations_that_miss_the_data_are_told)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 10, run.rate = 200;
    Log right = with_noise(*record(m, run), 4.5e-4, 1), wrong = with_noise(*right, 0, 1);
    for (size_t k = 0; k < wrong->rows; k++)
        column(wrong, "q2")[k] *= -1;
    for (const char *method : METHODS) {
        Fit f(m, right, method), g(m, wrong, method);
        ck_assert_int_eq(f.status, MK_OK);
        ck_assert(!f.warns("miss these data"));
        ck_assert(g.status != MK_OK || g.warns("miss these data"));
    }
}
END_TEST

START_TEST(a_command_beyond_the_limit_is_told)
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.seconds = 5, run.rate = 200;
    Log log = record(m, run);
    for (const char *method : {"output-error", "olsen"}) {
        mk_model narrow = m;
        narrow.u_max = 1;
        Fit wide(m, log, method), clipped(narrow, log, method);
        ck_assert(wide.status == MK_OK && !wide.warns("u_max"));
        ck_assert(clipped.status != MK_OK || clipped.warns("beyond u_max = 1"));
    }
}
END_TEST

/* So many that the first of them lead the way. */
START_TEST(output_error_on_many_runs_is_as_good_as_it_says)
{
    mk_model truth = rig(MK_PLANT_PENDUBOT), start = truth;
    for (int i = 0; i < 7; i++)
        start.parameter[i] *= i % 2 ? 0.8 : 1.2;
    Run run;
    run.seconds = 10, run.rate = 200;
    Log clean = record(truth, run);
    std::vector<Log> logs;
    std::vector<const mk_log *> views;
    for (unsigned i = 0; i < 16; i++) {
        logs.push_back(with_noise(*clean, 4.5e-4, i));
        views.push_back(logs.back().get());
    }
    Fit f(start, views, "output-error");
    ck_assert_int_eq(f.status, MK_OK);
    for (int i = 0; i < 7; i++) {
        const mk_ident_parameter &p = f.r->parameter[i];
        ck_assert_double_lt(fabs(p.value - truth.parameter[i]), 4 * p.std_error);
        ck_assert_double_lt(p.std_error, 2e-4 * truth.parameter[i]);
    }
}
END_TEST

/* --- the program --- */

START_TEST(the_program_writes_what_the_fit_knows)
{
    std::string log = open_loop_log("pendulum", "3*sin(6*t)+2*sin(13*t)", 4);
    std::string json = scratch("fit.json"), ini = scratch("fitted.ini");
    char out[8192];
    int rc = run_mechkit(out, sizeof out,
                         "identify --model " MK_SOURCE_DIR
                         "/models/pendulum.ini --fix p3 --out %s --json %s "
                         "--validate %s %s",
                         ini.c_str(), json.c_str(), log.c_str(), log.c_str());
    ck_assert_msg(rc == 0 && strstr(out, "largest correlation"), "%s", out);
    std::unique_ptr<char, void (*)(void *)> text(slurp_file(json.c_str()), free);
    std::unique_ptr<cJSON, void (*)(cJSON *)> root(cJSON_Parse(text.get()), cJSON_Delete);
    auto number = [](const cJSON *at, std::initializer_list<const char *> path) {
        for (const char *name : path)
            at = cJSON_GetObjectItem(at, name);
        return at && cJSON_IsNumber(at) ? at->valuedouble : (double)NAN;
    };
    for (const char *name : {"condition_number", "condition_number_scaled", "cost", "seconds"})
        ck_assert_msg(number(root.get(), {name}) > 0, "%s", name);
    auto element = [&](const char *matrix, int i, int k) {
        return cJSON_GetArrayItem(cJSON_GetArrayItem(cJSON_GetObjectItem(root.get(), matrix), i),
                                  k);
    };
    mk_model fitted;
    ck_assert_int_eq(mk_model_read(ini.c_str(), &fitted, nullptr), MK_OK);
    const char *const names[] = {"p1", "p2", "p4"};
    const int index[] = {0, 1, 3};
    for (int a = 0; a < 3; a++) {
        double error = number(root.get(), {"parameters", names[a], "stderr"});
        ck_assert_double_eq(number(root.get(), {"parameters", names[a], "value"}),
                            fitted.parameter[index[a]]);
        for (int b = 0; b < 3; b++)
            ck_assert_double_eq_tol(element("covariance", index[a], index[b])->valuedouble,
                                    element("correlation", index[a], index[b])->valuedouble *
                                        error *
                                        number(root.get(), {"parameters", names[b], "stderr"}),
                                    1e-9 * error * error);
    }
    ck_assert(cJSON_IsNull(element("correlation", 2, 2))); /* held */
    const cJSON *checked = cJSON_GetArrayItem(cJSON_GetObjectItem(root.get(), "validation"), 0);
    ck_assert_double_lt(
        cJSON_GetArrayItem(cJSON_GetObjectItem(checked, "nrmse_fitted"), 0)->valuedouble, 0.05);
}
END_TEST

} // namespace

Suite *suite_linear(void)
{
    Suite *s = suite_create("linear");
    TCase *c = tcase_create("all");
    tcase_set_timeout(c, 30);
    suite_add_tcase(s, c);
    tcase_add_test(c, a_start_from_rest_anchors_the_balance_of_energy);
    tcase_add_test(c, different_runs_are_not_averaged);
    tcase_add_test(c, a_log_without_motion_is_refused);
    tcase_add_test(c, a_stuck_joint_is_named);
    tcase_add_test(c, rows_without_readings_are_bridged_or_left_out);
    tcase_add_test(c, columns_of_nothing_and_infinite_values_are_named);
    tcase_add_test(c, logs_of_any_length_together_are_enough);
    tcase_add_test(c, ten_rows_are_refused_and_forty_do_not_crash);
    tcase_add_test(c, time_in_milliseconds_is_refused);
    tcase_add_test(c, output_error_does_not_take_a_wrong_zero_for_noise);
    tcase_add_test(c, output_error_warns_where_nothing_is_left_of_a_mass);
    tcase_add_test(c, output_error_cuts_out_a_hole_of_seconds);
    tcase_add_test(c, a_motor_that_warms_does_not_start_cold_again_after_a_hole);
    tcase_add_test(c, the_program_writes_what_the_fit_knows);

    c = tcase_create("many fits");
    tcase_set_timeout(c, 60);
    tcase_set_tags(c, "long");
    tcase_add_test(c, a_constant_command_is_refused_or_its_errors_say_so);
    tcase_add_test(c, output_error_warns_of_a_stuck_joint);
    tcase_add_test(c, output_error_refuses_a_command_of_the_wrong_sign);
    tcase_add_test(c, output_error_refuses_what_neither_follows_nor_tells);
    tcase_add_test(c, a_free_swing_takes_its_scale_from_a_held_parameter);
    tcase_add_test(c, repeats_are_averaged_and_the_errors_shrink_with_their_number);
    tcase_add_test(c, a_wider_window_is_taken_when_asked_for);
    tcase_add_test(c, a_command_beyond_the_limit_is_told);
    tcase_add_test(c, a_held_parameter_stays_and_the_others_are_found);
    tcase_add_test(c, a_log_of_another_rig_is_refused_or_warned_of);
    tcase_add_test(c, output_error_warns_of_swapped_columns_and_of_degrees);
    tcase_add_test(c, equations_that_miss_the_data_are_told);
    tcase_add_test(c, output_error_on_many_runs_is_as_good_as_it_says);
    tcase_add_test(c, every_method_finds_every_plants_parameters_on_exact_readings);
    tcase_add_test(c, stated_errors_are_those_of_repeated_noise);
    suite_add_tcase(s, c);
    return s;
}

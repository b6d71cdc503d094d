/* What can be known without a torque, and fits from values that are not known. */
#include "ident/first_values.hpp"

#include "suites.h"

#include <cmath>
#include <cstring>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "ident/scale.hpp"
#include "mechkit/data_check.h"
#include "mechkit/explain.h"
#include "mechkit/ident.h"
#include "mechkit/json.h"
#include "mechkit/sim.h"
#include "support/files.h"
#include "support/program.h"

namespace
{

struct FreeLog {
    void operator()(mk_log *log) const { mk_log_free(log); }
};
using Log = std::unique_ptr<mk_log, FreeLog>;
using Result = std::unique_ptr<mk_ident_result>;

struct Run {
    double amplitude = 0.0; /* of the command */
    double seconds = 10.0;
    bool command = true; /* there is a column of it */
    unsigned seed = 1;
};

/* A log of the model, released away from rest, at 500 Hz through encoders with half a count of
 * noise.
 */
Log record(const mk_model &m, const Run &run)
{
    mk_log *log;
    mk_sim *sim;
    const double rate = 500.0, release[2] = {1.2, 0.7}, still[2] = {0.0, 0.0};
    const size_t rows = (size_t)(run.seconds * rate) + 1;
    const int joints = mk_model_joints(&m);
    std::mt19937 random(run.seed);
    std::normal_distribution<double> normal(0.0, 0.5);
    ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
    double *q[2] = {nullptr, nullptr}, *t = mk_log_add_column(log, "t");
    double *u = run.command ? mk_log_add_column(log, "u") : nullptr;
    for (int j = 0; j < joints; j++)
        q[j] = mk_log_add_column(log, j ? "q2" : "q1");
    double x[MK_MAX_STATES], y[2];
    ck_assert_int_eq(mk_sim_create(&m, nullptr, &sim, nullptr), MK_OK);
    mk_model_initial_state(&m, mk_plant(m.plant)->rest, still, x);
    for (int j = 0; j < joints && run.amplitude < 0.01; j++)
        x[j] += release[j];
    ck_assert_int_eq(mk_sim_reset(sim, 0, x, nullptr), MK_OK);
    for (size_t k = 0; k < rows; k++) {
        t[k] = (double)k / rate;
        double command[2] = {run.amplitude * (sin(6 * t[k]) + 0.6 * sin(2.3 * t[k])), 0};
        mk_sim_measure(sim, y);
        if (u)
            u[k] = command[0];
        for (int j = 0; j < joints; j++) {
            const double count = mk_model_count(&m, j);
            q[j][k] = std::round(y[j] / count + normal(random)) * count;
        }
        ck_assert_int_eq(mk_sim_advance(sim, (double)(k + 1) / rate, command, nullptr), MK_OK);
    }
    mk_sim_destroy(sim);
    if (!run.command)
        ck_assert_int_eq(mk_log_set_meta(log, "input", "none"), MK_OK);
    return Log(log);
}

struct Fit {
    Result r = std::make_unique<mk_ident_result>();
    mk_error err = MK_ERROR_INIT;
    mk_ident_options options = {};
    enum mk_status status = MK_ERR_STATE;

    Fit &of(const mk_model &m, const Log &log)
    {
        const mk_log *one = log.get();
        status = mk_identify(&m, &one, 1, &options, r.get(), &err);
        return *this;
    }
};

mk_model rig(enum mk_plant_kind kind)
{
    mk_model m;
    mk_model_default(kind, &m);
    return m;
}

/* A pendubot with friction of its own in the elbow. */
mk_model with_elbow_friction()
{
    mk_model m = rig(MK_PLANT_PENDUBOT);
    ck_assert_int_eq(mk_model_add_effect(&m, "viscous", 2, nullptr), MK_OK);
    m.effect[0].value[0] = 0.01;
    return m;
}

/* All that scales with torque, times a factor. */
mk_model rescaled(mk_model m, double factor)
{
    for (int i = 0; i < mk_model_parameter_count(&m); i++)
        if (mk::scales_with_torque(m, i))
            mk_model_set_parameter(&m, i, factor * mk_model_parameter(&m, i));
    return m;
}

/* Ratios to p1 within four and a half of their standard errors, which are small. */
void expect_ratios(const mk_ident_result &r, const mk_model &truth, double most)
{
    ck_assert(r.scale_free);
    ck_assert_int_eq(r.scale_holder, 0);
    ck_assert_int_eq(r.ratio_count, mk_model_parameter_count(&truth) - 1);
    for (int i = 0; i < r.ratio_count; i++) {
        const mk_ident_ratio &p = r.ratio[i];
        const double right = mk_model_parameter(&truth, p.parameter) / truth.parameter[0];
        ck_assert_msg(std::fabs(p.value - right) < 4.5 * p.std_error && p.std_error < most * right,
                      "%s: %g +- %g, right is %g", p.name, p.value, p.std_error, right);
    }
}

} // namespace

/* --- without a torque ------------------------------------------------------------------------ */

START_TEST(units_of_ratios_follow_from_those_of_their_parts)
{
    const mk_model m = with_elbow_friction();
    const char *const unit_and_base[][2] = {{"N m/rad", "kg m^2/s^2"},
                                            {"kg m^2", "kg m^2"},
                                            {"Hz", "1/s"},
                                            {"N m s^2/rad^2", "kg m^2"},
                                            {"rad", ""}};
    for (const auto &pair : unit_and_base) {
        const std::string base = mk::unit_of(mk::dimension_of(pair[0]));
        ck_assert_str_eq(base.c_str(), pair[1]);
    }
    for (int i = 0; i < mk_model_parameter_count(&m); i++)
        ck_assert(mk::scales_with_torque(m, i));
}
END_TEST

START_TEST(every_plant_leaves_its_scale_open_without_a_command)
{
    for (int kind = 0; kind < MK_PLANT_COUNT; kind++) {
        const mk_model m = rig((enum mk_plant_kind)kind);
        ck_assert_msg(mk::is_homogeneous(m), "%s", mk_plant(m.plant)->name);
        ck_assert_int_eq(mk::scale_holder(m, nullptr), 0);
    }
    const bool unknown[MK_MAX_FIT_PARAMETERS] = {true};
    ck_assert_int_eq(mk::scale_holder(rig(MK_PLANT_PENDUBOT), unknown), 1);
}
END_TEST

START_TEST(a_free_swing_gives_ratios_and_their_errors)
{
    const mk_model truth = with_elbow_friction();
    Run run;
    run.command = _i == 1;
    const Log log = record(truth, run);
    /* Its given scale is another. */
    mk_model given = rescaled(truth, 3.0);
    for (int i = 1; i < 7; i++)
        given.parameter[i] *= i % 2 ? 1.2 : 0.9;
    Fit f;
    f.of(given, log);
    ck_assert_msg(f.status == MK_OK, "%s", f.err.message);
    expect_ratios(*f.r, truth, 0.05);
    ck_assert(f.r->parameter[0].fixed && f.r->parameter[0].value == given.parameter[0]);
    for (int i = 0; i < f.r->parameter_count; i++)
        ck_assert_msg(std::isnan(f.r->parameter[i].std_error), "%s", f.r->parameter[i].name);
    for (double e : f.r->model.parameter_stderr)
        ck_assert(e == 0.0);
    ck_assert_str_eq(f.r->ratio[0].name, "p2/p1");
    ck_assert_str_eq(f.r->ratio[0].unit, "");
    ck_assert_str_eq(f.r->ratio[2].name, "p4/p1");
    ck_assert_str_eq(f.r->ratio[2].unit, "1/m");
    ck_assert_str_eq(f.r->ratio[4].unit, "1/s");
    ck_assert_str_eq(f.r->ratio[6].name, "effect.viscous.coefficient/p1");
    for (int i = 0; i < f.r->warning_count; i++)
        ck_assert_msg(!strstr(f.r->warning[i], "does not follow"), "%s", f.r->warning[i]);
}
END_TEST

START_TEST(linear_methods_give_ratios_too)
{
    const mk_model truth = rig(MK_PLANT_PENDULUM);
    const Log log = record(truth, {});
    for (const char *method : {"sls", "wls", "swevers", "olsen", "energy"}) {
        Fit f;
        f.options.method = method;
        f.of(rescaled(truth, 0.2), log);
        ck_assert_msg(f.status == MK_OK, "%s: %s", method, f.err.message);
        ck_assert(f.r->scale_free && f.r->ratio_count == 3);
        ck_assert_double_eq_tol(f.r->ratio[0].value * truth.parameter[0] / truth.parameter[1], 1.0,
                                2e-3);
        ck_assert(std::isnan(f.r->parameter[1].std_error));
    }
}
END_TEST

START_TEST(the_error_of_the_held_inertia_goes_into_all_others)
{
    mk_model given = rig(MK_PLANT_PENDULUM);
    const Log log = record(given, {});
    given.parameter_stderr[0] = 0.03 * given.parameter[0];
    Fit f;
    f.of(given, log);
    ck_assert_int_eq(f.status, MK_OK);
    ck_assert_double_eq_tol(f.r->parameter[1].std_error / f.r->parameter[1].value, 0.03, 1e-3);
    ck_assert_double_lt(f.r->ratio[0].std_error / f.r->ratio[0].value, 1e-3);
    ck_assert_double_eq_tol(f.r->model.parameter_stderr[1], f.r->parameter[1].std_error, 1e-15);
    ck_assert_double_eq_tol(f.r->model.parameter_stderr[0], given.parameter_stderr[0], 1e-15);
}
END_TEST

START_TEST(who_holds_another_parameter_has_the_scale_from_it)
{
    const mk_model truth = rig(MK_PLANT_PENDULUM);
    mk_model given = truth;
    given.parameter[0] *= 1.3;
    Fit f;
    f.options.fixed[1] = true;
    f.of(given, record(truth, {}));
    ck_assert_int_eq(f.status, MK_OK);
    ck_assert(!f.r->scale_free);
    ck_assert_double_lt(f.r->parameter[0].std_error, 1e-2 * truth.parameter[0]);
    ck_assert_double_eq_tol(f.r->parameter[0].value / truth.parameter[0], 1.0, 2e-3);
}
END_TEST

START_TEST(a_command_that_moves_nothing_tells_no_scale)
{
    const mk_model truth = rig(MK_PLANT_PENDULUM);
    Run run;
    run.amplitude = 1e-5;
    Fit f;
    f.of(truth, record(truth, run));
    ck_assert_msg(f.status == MK_OK, "%s", f.err.message);
    expect_ratios(*f.r, truth, 0.05);
}
END_TEST

START_TEST(a_driven_rig_has_a_scale)
{
    const mk_model truth = rig(MK_PLANT_PENDULUM);
    Run run;
    run.amplitude = 2.0;
    Fit f;
    f.of(truth, record(truth, run));
    ck_assert_int_eq(f.status, MK_OK);
    ck_assert(!f.r->scale_free && f.r->ratio_count == 0);
    ck_assert(f.r->parameter[0].std_error > 0.0);
}
END_TEST

START_TEST(the_program_says_what_is_known_of_a_free_swing)
{
    char out[8192];
    mk_error err = MK_ERROR_INIT;
    mk_model truth = rig(MK_PLANT_PENDULUM);
    truth.no_motor = true;
    Run run;
    run.command = false;
    const Log log = record(truth, run);
    const std::string model = scratch("swing.ini"), data = scratch("swing.csv"),
                      json = scratch("swing.json"), fitted = scratch("swing_fitted.ini");
    ck_assert_int_eq(mk_log_write(data.c_str(), log.get(), &err), MK_OK);
    ck_assert_int_eq(mk_model_write(model.c_str(), &truth, nullptr, &err), MK_OK);
    int code = run_mechkit(out, sizeof out, "identify --model %s --json %s --out %s %s",
                           model.c_str(), json.c_str(), fitted.c_str(), data.c_str());
    ck_assert_msg(code == 0 && strstr(out, "the scale is free") && strstr(out, "p2/p1"), "%d %s",
                  code, out);
    char *text = slurp_file(json.c_str());
    cJSON *root = cJSON_Parse(text);
    ck_assert_str_eq(cJSON_GetObjectItem(root, "scale")->valuestring, "free");
    ck_assert_str_eq(cJSON_GetObjectItem(root, "scale_held")->valuestring, "p1");
    const cJSON *first = cJSON_GetArrayItem(cJSON_GetObjectItem(root, "ratios"), 0);
    ck_assert_str_eq(cJSON_GetObjectItem(first, "name")->valuestring, "p2/p1");
    ck_assert_str_eq(cJSON_GetObjectItem(first, "unit")->valuestring, "1/s^2");
    ck_assert(cJSON_GetObjectItem(first, "stderr")->valuedouble > 0.0);
    const cJSON *p2 = cJSON_GetObjectItem(cJSON_GetObjectItem(root, "parameters"), "p2");
    ck_assert(cJSON_IsNull(cJSON_GetObjectItem(p2, "stderr")));
    cJSON_Delete(root);
    free(text);
    mk_model back;
    ck_assert_int_eq(mk_model_read(fitted.c_str(), &back, &err), MK_OK);
    ck_assert(back.no_motor);
    code = run_mechkit(out, sizeof out, "simulate --model %s --input %s --window 1 --json -",
                       fitted.c_str(), data.c_str());
    ck_assert_msg(code == 0 && strstr(out, "nrmse"), "%d %s", code, out);
}
END_TEST

START_TEST(a_cause_is_found_in_a_free_swing)
{
    mk_model truth = rig(MK_PLANT_PENDULUM);
    const mk_model given = truth;
    ck_assert_int_eq(mk_model_add_effect(&truth, "quadratic-drag", 1, nullptr), MK_OK);
    truth.effect[0].value[0] = 0.02;
    Run run;
    run.command = false, run.seconds = 8.0;
    const Log log = record(truth, run);
    const mk_log *one = log.get();
    auto e = std::make_unique<mk_explanation>();
    mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_explain(&given, &one, 1, nullptr, 0, nullptr, e.get(), &err) == MK_OK, "%s",
                  err.message);
    ck_assert(e->scale_free);
    ck_assert(e->extended.parameter[0] == given.parameter[0] && !e->extended.no_motor);
    ck_assert_int_eq(e->verdict, MK_VERDICT_EFFECT);
    ck_assert_str_eq(e->cause[0].effect->name, "quadratic-drag");
    ck_assert_double_eq_tol(e->cause[0].value[0] / 0.02, 1.0, 0.2);
    ck_assert_str_eq(e->next.input, "");
}
END_TEST

/* --- values that are not known ---------------------------------------------------------------- */

namespace
{

/* Each base parameter off by a factor of up to `span` either way, as far as that makes a rig. */
mk_model scattered(const mk_model &truth, double span, unsigned seed)
{
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> exponent(-1.0, 1.0);
    mk_model m = truth;
    do {
        for (int i = 0; i < mk_plant(m.plant)->parameter_count; i++)
            m.parameter[i] = truth.parameter[i] * std::pow(span, exponent(random));
    } while (mk_model_check(&m, nullptr) != MK_OK);
    return m;
}

void expect_the_same(const mk_ident_result &a, const mk_ident_result &b, const char *rig)
{
    for (int i = 0; i < a.parameter_count; i++)
        ck_assert_msg(std::fabs(a.parameter[i].value - b.parameter[i].value) <
                          0.3 * b.parameter[i].std_error + 1e-6 * std::fabs(b.parameter[i].value),
                      "%s: %s is %g, from good values %g +- %g", rig, a.parameter[i].name,
                      a.parameter[i].value, b.parameter[i].value, b.parameter[i].std_error);
}

const double drive[] = {3.0, 2.0, 1.5, 3.0, 2.0, 4.0, 1.5}; // by plant: command units
static_assert(sizeof drive / sizeof drive[0] == MK_PLANT_COUNT, "a plant without a command");

} // namespace

// With the other sign of the command values that are far off can predict better, by chance. No
// pendulum could move like that.
START_TEST(values_that_are_far_off_do_not_turn_a_command)
{
    const unsigned seeds[] = {9, 12, 23};
    const mk_model truth = rig(MK_PLANT_PENDULUM);
    Run run;
    run.amplitude = drive[truth.plant], run.seed = seeds[_i];
    const Log log = record(truth, run);
    const mk_model given = scattered(truth, 30.0, 100u + seeds[_i]);
    const mk_log *one = log.get();
    auto check = std::make_unique<mk_data_check>();
    ck_assert_int_eq(mk_data_check_logs(&given, &one, 1, MK_DATA_IDENTIFY, 1, check.get(), nullptr),
                     MK_OK);
    const mk_data_finding *fatal = mk_data_check_fatal(check.get());
    ck_assert_msg(!fatal, "%s", fatal ? fatal->what : "");
}
END_TEST

START_TEST(a_fit_ends_at_the_same_values_wherever_it_starts)
{
    const int kind = _i % MK_PLANT_COUNT, round = _i / MK_PLANT_COUNT;
    const mk_model truth = rig((enum mk_plant_kind)kind);
    const unsigned seed = (unsigned)(7 * round + kind); // however many plants there are
    const char *name = mk_plant(truth.plant)->name;
    Run run;
    run.amplitude = drive[truth.plant], run.seed = seed;
    const Log log = record(truth, run);
    Fit good, off, open;
    good.of(truth, log);
    ck_assert_msg(good.status == MK_OK, "%s: %s", name, good.err.message);
    off.of(scattered(truth, 30.0, 100u + seed), log);
    ck_assert_msg(off.status == MK_OK, "%s: %s", name, off.err.message);
    expect_the_same(*off.r, *good.r, name);
    for (int i = 0; i < mk_plant(truth.plant)->parameter_count; i++)
        open.options.unknown[i] = true;
    open.of(truth, log);
    ck_assert_msg(open.status == MK_OK, "%s: %s", name, open.err.message);
    expect_the_same(*open.r, *good.r, name);
}
END_TEST

/* An unknown friction is found beside masses as they were given, a little off. */
START_TEST(what_was_given_stays_where_other_values_are_open)
{
    const mk_model truth = rig(MK_PLANT_PENDUBOT);
    Run run;
    run.amplitude = drive[truth.plant];
    const Log log = record(truth, run);
    mk::IdentProblem problem = {};
    problem.model = truth;
    for (int i = 0; i < 5; i++)
        problem.model.parameter[i] *= 1.05;
    problem.model.parameter[6] = 7.0;
    problem.options.unknown[6] = true;
    problem.moves[0] = problem.moves[1] = true;
    problem.logs = {log.get()};
    problem.records.resize(1);
    ck_assert_int_eq(mk_record_from_log(log.get(), &truth, &problem.records[0], nullptr), MK_OK);
    const mk::FitLog rows = mk::fit_log(problem.records[0], truth, 0, problem.records[0].rows, 0);
    const mk_model start =
        mk::first_values(problem, {&rows}, mk::FitOptions(), mk::BETTER_PRIOR).front();
    for (int i = 0; i < 6; i++)
        ck_assert_double_eq(start.parameter[i], problem.model.parameter[i]);
    ck_assert_double_eq_tol(start.parameter[6] / truth.parameter[6], 1.0, 0.5);
}
END_TEST

START_TEST(a_model_file_may_leave_values_open)
{
    mk_model m;
    mk_error err = MK_ERROR_INIT;
    bool unknown[MK_MAX_FIT_PARAMETERS];
    const std::string path =
        scratch_text("open.ini", "[rig]\nkind = pendulum\nu_to_torque = 1\n[parameters]\np1 = ?\n"
                                 "p2 = 0.4\np3 = ?\np4 = 0\n[effect.viscous]\njoint = 1\n"
                                 "coefficient = 0.1\n[effect.stribeck]\njoint = 1\nlevel = ?\n"
                                 "velocity = 1\n");
    ck_assert_int_eq(mk_model_read(path.c_str(), &m, &err), MK_ERR_RANGE);
    ck_assert_msg(err.line == 5 && strstr(err.message, "p1") && strstr(err.message, "identify"),
                  "%d %s", err.line, err.message);
    ck_assert_msg(mk_model_read_open(path.c_str(), &m, unknown, &err) == MK_OK, "%s", err.message);
    for (int i = 0; i < MK_MAX_FIT_PARAMETERS; i++)
        ck_assert_msg(unknown[i] == (i == 0 || i == 2 || i == 5), "%d", i);
    ck_assert(m.parameter[1] == 0.4 && m.parameter[0] > 0.0 && m.effect[1].value[1] == 1.0);
    /* Beside known values of another size those in their place still make a rig. */
    const std::string odd =
        scratch_text("odd.ini", "[rig]\nkind = pendubot\n[parameters]\np1 = ?\np2 = 0.001\n"
                                "p3 = 0.4\np4 = 1\np5 = 1\np6 = 0\np7 = 0\n");
    ck_assert_msg(mk_model_read_open(odd.c_str(), &m, unknown, &err) == MK_OK, "%s", err.message);
    const std::string whole =
        scratch_text("whole.ini", "[rig]\nkind = pendulum\n[parameters]\np1 = 1\np2 = 1\np3 = 0\n"
                                  "p4 = 0\n[effect.cogging]\njoint = 1\namplitude = 0.1\n"
                                  "cycles = ?\nphase = 0\n");
    ck_assert_int_ne(mk_model_read_open(whole.c_str(), &m, unknown, &err), MK_OK);
    ck_assert_msg(strstr(err.message, "no fit finds"), "%s", err.message);
}
END_TEST

START_TEST(the_program_fits_what_is_open_and_says_where_it_cannot)
{
    char out[8192];
    mk_error err = MK_ERROR_INIT;
    const mk_model truth = rig(MK_PLANT_PENDULUM);
    Run run;
    run.amplitude = 2.0;
    const Log log = record(truth, run);
    const std::string data = scratch("open.csv"), fitted = scratch("open_fitted.ini");
    ck_assert_int_eq(mk_log_write(data.c_str(), log.get(), &err), MK_OK);
    const std::string model =
        scratch_text("open.ini", "[rig]\nkind = pendulum\n[parameters]\np1 = ?\n"
                                 "p2 = ?\np3 = ?\np4 = ?\n");
    int code = run_mechkit(out, sizeof out, "simulate --model %s --input %s --window 1 --json -",
                           model.c_str(), data.c_str());
    ck_assert_msg(code == 3 && strstr(out, "open.ini:4: p1") && strstr(out, "mechkit identify"),
                  "%d %s", code, out);
    code = run_mechkit(out, sizeof out, "identify --model %s --out %s --json - %s", model.c_str(),
                       fitted.c_str(), data.c_str());
    ck_assert_msg(code == 0, "%d %s", code, out);
    ck_assert_msg(out[0] == '{', "%s", out); /* JSON alone */
    mk_model m;
    ck_assert_msg(mk_model_read(fitted.c_str(), &m, &err) == MK_OK, "%s", err.message);
    for (int i = 0; i < 4; i++)
        ck_assert_double_eq_tol(m.parameter[i] / truth.parameter[i], 1.0, 0.05);
}
END_TEST

START_TEST(a_cause_is_the_same_whatever_was_given)
{
    mk_model truth = rig(MK_PLANT_PENDULUM);
    const mk_model given = truth, off = scattered(truth, 30.0, 7);
    ck_assert_int_eq(mk_model_add_effect(&truth, "quadratic-drag", 1, nullptr), MK_OK);
    truth.effect[0].value[0] = 0.02;
    Run run;
    run.amplitude = 3.0;
    const Log log = record(truth, run);
    const mk_log *one = log.get();
    auto right = std::make_unique<mk_explanation>(), far = std::make_unique<mk_explanation>();
    ck_assert_int_eq(mk_explain(&given, &one, 1, nullptr, 0, nullptr, right.get(), nullptr), MK_OK);
    ck_assert_int_eq(mk_explain(&off, &one, 1, nullptr, 0, nullptr, far.get(), nullptr), MK_OK);
    ck_assert_int_eq(right->verdict, MK_VERDICT_EFFECT);
    ck_assert_int_eq(far->verdict, MK_VERDICT_EFFECT);
    ck_assert(right->cause[0].effect == far->cause[0].effect);
    ck_assert_double_lt(std::fabs(right->cause[0].value[0] - far->cause[0].value[0]),
                        right->cause[0].std_error[0]);
    for (int i = 0; i < 4; i++)
        ck_assert_double_lt(std::fabs(right->extended.parameter[i] - far->extended.parameter[i]),
                            right->std_error[i]);
}
END_TEST

Suite *suite_ratios(void)
{
    Suite *s = suite_create("ratios");
    TCase *c = tcase_create("no torque");
    tcase_set_timeout(c, 120);
    tcase_add_test(c, units_of_ratios_follow_from_those_of_their_parts);
    tcase_add_test(c, every_plant_leaves_its_scale_open_without_a_command);
    tcase_add_loop_test(c, a_free_swing_gives_ratios_and_their_errors, 0, 2);
    tcase_add_test(c, linear_methods_give_ratios_too);
    tcase_add_test(c, the_error_of_the_held_inertia_goes_into_all_others);
    tcase_add_test(c, who_holds_another_parameter_has_the_scale_from_it);
    tcase_add_test(c, a_command_that_moves_nothing_tells_no_scale);
    tcase_add_test(c, a_driven_rig_has_a_scale);
    tcase_add_test(c, the_program_says_what_is_known_of_a_free_swing);
    tcase_add_test(c, a_cause_is_found_in_a_free_swing);
    suite_add_tcase(s, c);
    c = tcase_create("unknown values");
    tcase_set_timeout(c, 120);
    tcase_add_loop_test(c, a_fit_ends_at_the_same_values_wherever_it_starts, MK_PLANT_COUNT,
                        MK_PLANT_COUNT + 1);
    tcase_add_loop_test(c, values_that_are_far_off_do_not_turn_a_command, 0, 3);
    tcase_add_test(c, what_was_given_stays_where_other_values_are_open);
    tcase_add_test(c, a_model_file_may_leave_values_open);
    tcase_add_test(c, the_program_fits_what_is_open_and_says_where_it_cannot);
    suite_add_tcase(s, c);
    c = tcase_create("many unknown values");
    tcase_set_timeout(c, 120);
    tcase_set_tags(c, "long");
    tcase_add_loop_test(c, a_fit_ends_at_the_same_values_wherever_it_starts, 0, MK_PLANT_COUNT);
    tcase_add_loop_test(c, a_fit_ends_at_the_same_values_wherever_it_starts, MK_PLANT_COUNT + 1,
                        2 * MK_PLANT_COUNT + 1);
    tcase_add_test(c, a_cause_is_the_same_whatever_was_given);
    suite_add_tcase(s, c);
    return s;
}

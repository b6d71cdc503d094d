// Which of a log's columns drives a model: logs are those of an independent simulator, to which one
// column is true and the other is not.
#include "suites.h"

#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "mechkit/explain.h"
#include "mechkit/ident.h"
#include "mechkit/json.h"
#include "support/cases.hpp"
#include "support/files.h"
#include "support/program.h"

namespace
{

constexpr double LATE = 0.008; // s
constexpr int LOGS = 4;
constexpr double RUB = 0.02; // dry friction of joint 2, which the model lacks

enum class Truth { sent_late, measured, either, one_column };

mk_model pendubot(enum mk_input input)
{
    mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    for (int i = 0; i < 7; i++)
        m.parameter[i] *= i % 2 ? 1.05 : 0.96;
    m.input = input;
    return m;
}

// What a slow sensor makes of a command.
std::vector<double> filtered(const mk_log *log)
{
    const double *u = mk_log_get(log, "u");
    std::vector<double> out(log->rows);
    for (size_t k = 1; k < out.size(); k++)
        out[k] = out[k - 1] + 0.08 * (u[k] - out[k - 1]);
    return out;
}

truth::OwnedLog record(Truth which, uint64_t seed, double friction, double seconds)
{
    truth::Rig rig;
    truth::Recording how;
    mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    rig.kind = "pendubot";
    rig.p.assign(m.parameter, m.parameter + 7);
    if (which == Truth::sent_late)
        rig.effects.push_back({"input-delay", 0, {{"delay", LATE}}});
    if (friction > 0.0)
        rig.effects.push_back({"coulomb", 2, {{"level", friction}}});
    how.seconds = seconds;
    how.input = seed % 2 ? "multisine" : "chirp";
    how.seed = seed;
    truth::OwnedLog log = truth::as_log(truth::record(rig, how), rig, how);
    if (which == Truth::one_column)
        return log;
    double *sent = mk_log_add_column(log.get(), "u_cmd");
    ck_assert_ptr_nonnull(sent);
    double *u = nullptr;
    for (size_t c = 0; c < log->column_count; c++)
        if (std::string(log->columns[c].name) == "u")
            u = log->columns[c].data;
    const std::vector<double> other = filtered(log.get());
    for (size_t k = 0; k < log->rows; k++) {
        sent[k] = which == Truth::measured ? other[k] : u[k];
        u[k] = which == Truth::sent_late ? other[k] : u[k];
    }
    return log;
}

struct Logs {
    std::vector<truth::OwnedLog> all;
    std::vector<const mk_log *> view;
};

Logs logs_of(Truth which, double friction, int count = LOGS, double seconds = 4.0)
{
    Logs logs;
    for (int i = 0; i < count; i++) {
        logs.all.push_back(record(which, 71 + (uint64_t)i, friction, seconds));
        logs.view.push_back(logs.all.back().get());
    }
    return logs;
}

std::unique_ptr<mk_input_comparison> compared(const Logs &logs, enum mk_input said)
{
    auto c = std::make_unique<mk_input_comparison>();
    const mk_model m = pendubot(said);
    mk_error err = MK_ERROR_INIT;
    ck_assert_msg(
        mk_compare_inputs(&m, logs.view.data(), logs.view.size(), nullptr, c.get(), &err) == MK_OK,
        "%s", err.message);
    ck_assert_int_eq(c->model.input, c->taken);
    ck_assert_int_eq(c->logs, (int)logs.view.size());
    return c;
}

START_TEST(a_command_that_acts_late_is_taken_where_what_was_measured_of_it_is_wrong)
{
    const Logs logs = logs_of(Truth::sent_late, RUB);
    for (enum mk_input said : {MK_INPUT_UNSAID, MK_INPUT_MEASURED, MK_INPUT_COMMANDED}) {
        const auto c = compared(logs, said);
        ck_assert_int_eq(c->taken, MK_INPUT_COMMANDED);
        ck_assert_int_eq(c->changed, said != MK_INPUT_COMMANDED);
        ck_assert_int_eq(c->better, LOGS);
        ck_assert_double_lt(c->ratio, 0.5);
        ck_assert_double_lt(c->nrmse[MK_INPUT_COMMANDED][1], c->nrmse[MK_INPUT_MEASURED][1]);
        ck_assert_double_eq_tol(c->delay, LATE, 4.0 * c->delay_error + 2e-4);
        ck_assert_double_lt(c->delay_error, 1e-3);
        ck_assert_int_eq(mk_effect(c->model.effect[0].index) == mk_effect_by_name("input-delay"),
                         1);
        ck_assert_double_eq(c->model.parameter[0], pendubot(said).parameter[0]);
    }
}
END_TEST

START_TEST(what_was_measured_is_taken_where_the_command_is_wrong)
{
    const Logs logs = logs_of(Truth::measured, RUB);
    for (enum mk_input said : {MK_INPUT_UNSAID, MK_INPUT_MEASURED, MK_INPUT_COMMANDED}) {
        const auto c = compared(logs, said);
        ck_assert_int_eq(c->taken, MK_INPUT_MEASURED);
        ck_assert_int_eq(c->changed, said == MK_INPUT_COMMANDED);
        ck_assert_int_eq(c->model.effect_count, 0);
    }
}
END_TEST

START_TEST(a_tie_goes_to_what_the_model_says)
{
    for (double friction : {0.0, RUB}) {
        const Logs logs = logs_of(Truth::either, friction);
        for (enum mk_input said : {MK_INPUT_UNSAID, MK_INPUT_MEASURED, MK_INPUT_COMMANDED}) {
            const auto c = compared(logs, said);
            ck_assert_int_eq(c->taken,
                             said == MK_INPUT_COMMANDED ? MK_INPUT_COMMANDED : MK_INPUT_MEASURED);
            ck_assert(!c->changed);
        }
    }
}
END_TEST

START_TEST(two_logs_with_both_columns_are_needed_to_compare_them)
{
    const mk_model m = pendubot(MK_INPUT_UNSAID);
    const Logs one = logs_of(Truth::either, 0.0, 1), without = logs_of(Truth::one_column, 0.0, 2);
    mk_input_comparison c;
    mk_error err = MK_ERROR_INIT;
    for (const Logs *logs : {&one, &without}) {
        ck_assert_int_eq(
            mk_compare_inputs(&m, logs->view.data(), logs->view.size(), nullptr, &c, &err),
            MK_ERR_RANGE);
        ck_assert_msg(strstr(err.message, "two logs") && strstr(err.message, "u_cmd"), "%s",
                      err.message);
    }
    ck_assert(mk_log_has_both_inputs(one.view[0], &m));
    ck_assert(!mk_log_has_both_inputs(without.view[0], &m));
}
END_TEST

START_TEST(two_logs_are_enough_to_compare_them)
{
    const auto c = compared(logs_of(Truth::sent_late, 0.0, 2, 2.0), MK_INPUT_MEASURED);
    ck_assert_int_eq(c->taken, MK_INPUT_COMMANDED);
    ck_assert(c->changed);
}
END_TEST

// Runs identify, and reads the fitted model and the JSON's `input`.
struct Identified {
    char out[8192];
    int code;
    mk_model fitted = {};
    std::string taken;
    bool changed = false, compared = false;

    Identified(const std::string &options, const std::string &logs)
    {
        const std::string model = scratch("both.ini"), json = scratch("both.json"),
                          fit = scratch("both_fitted.ini");
        code = run_mechkit(out, sizeof out, "identify --model %s --json %s --out %s %s %s",
                           model.c_str(), json.c_str(), fit.c_str(), options.c_str(), logs.c_str());
        if (code != 0)
            return;
        ck_assert_int_eq(mk_model_read(fit.c_str(), &fitted, nullptr), MK_OK);
        char *text = slurp_file(json.c_str());
        cJSON *root = cJSON_Parse(text);
        const cJSON *input = cJSON_GetObjectItem(root, "input");
        taken = cJSON_GetObjectItem(input, "taken")->valuestring;
        changed = cJSON_IsTrue(cJSON_GetObjectItem(input, "changed"));
        compared = cJSON_GetObjectItem(input, "logs_left_out");
        cJSON_Delete(root);
        free(text);
    }
};

START_TEST(identify_compares_where_nobody_says_which_column_it_is)
{
    const Logs logs = logs_of(Truth::sent_late, RUB);
    std::string files;
    for (int i = 0; i < LOGS; i++) {
        const std::string path = scratch(("both" + std::to_string(i) + ".csv").c_str());
        ck_assert_int_eq(mk_log_write(path.c_str(), logs.view[(size_t)i], nullptr), MK_OK);
        files += " " + path;
    }
    mk_model m = pendubot(MK_INPUT_UNSAID);
    const std::string model = scratch("both.ini"), one = files.substr(0, files.find(' ', 1));
    ck_assert_int_eq(mk_model_write(model.c_str(), &m, nullptr, nullptr), MK_OK);
    const Identified silent("", files);
    ck_assert_msg(silent.code == 0 && silent.compared && silent.changed, "%s", silent.out);
    ck_assert_str_eq(silent.taken.c_str(), "commanded");
    ck_assert_int_eq(silent.fitted.input, MK_INPUT_COMMANDED);
    ck_assert_int_eq(silent.fitted.effect_count, 1);
    ck_assert_ptr_nonnull(strstr(silent.out, "predicts the logs left out better"));
    const Identified told("--input measured", files), single("", one);
    ck_assert_str_eq(told.taken.c_str(), "measured");
    ck_assert_int_eq(told.fitted.input, MK_INPUT_MEASURED);
    ck_assert(!told.compared && !single.compared && single.fitted.effect_count == 0);
    const Identified asked("--input compare", one), linear("--input compare --method wls", files);
    ck_assert_msg(asked.code == 3 && strstr(asked.out, "two logs"), "%d %s", asked.code, asked.out);
    ck_assert_msg(linear.code == 2 && strstr(linear.out, "cannot fit"), "%s", linear.out);
    m.input = MK_INPUT_COMMANDED;
    ck_assert_int_eq(mk_model_write(model.c_str(), &m, nullptr, nullptr), MK_OK);
    const Identified said("", files);
    ck_assert_str_eq(said.taken.c_str(), "commanded");
    ck_assert(!said.compared && said.fitted.effect_count == 0);
    // Nobody may take it for one that was looked at for how late it acts.
    ck_assert_msg(strstr(said.out, "as if it acted at once"), "%s", said.out);
    ck_assert_msg(!strstr(told.out, "as if it acted at once"), "%s", told.out);
}
END_TEST

std::unique_ptr<mk_explanation> explained(Truth which)
{
    const Logs logs = logs_of(which, RUB, 3);
    auto e = std::make_unique<mk_explanation>();
    const mk_model m = pendubot(MK_INPUT_UNSAID);
    mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_explain(&m, logs.view.data(), 2, &logs.view[2], 1, nullptr, e.get(), &err) ==
                      MK_OK,
                  "%s", err.message);
    ck_assert_int_eq(e->verdict, MK_VERDICT_EFFECT);
    ck_assert_int_eq(e->cause_count, 1);
    ck_assert_str_eq(e->cause[0].effect->name, "coulomb");
    return e;
}

START_TEST(explain_finds_the_column_before_the_cause)
{
    const auto e = explained(Truth::sent_late);
    ck_assert(e->input.made && e->input.changed);
    ck_assert_int_eq(e->given.input, MK_INPUT_UNSAID);
    ck_assert_int_eq(e->given.effect_count, 0);
    ck_assert_int_ne(e->refit.input, MK_INPUT_COMMANDED);
    ck_assert_int_eq(e->extended.input, MK_INPUT_COMMANDED);
    ck_assert_double_eq_tol(e->input.delay, LATE, 4.0 * e->input.delay_error + 5e-5);
    ck_assert_double_eq(e->extended.effect[0].value[0], e->input.delay);
    ck_assert(e->offered);
    for (int j = 0; j < 2; j++)
        ck_assert_double_lt(e->after[j], 0.3 * e->refitted[j]);
}
END_TEST

START_TEST(explain_keeps_the_column_that_is_right)
{
    const auto e = explained(Truth::measured);
    ck_assert(e->input.made && !e->input.changed);
    ck_assert_int_ne(e->extended.input, MK_INPUT_COMMANDED);
    ck_assert(!explained(Truth::one_column)->input.made);
}
END_TEST

} // namespace

Suite *suite_inputs(void)
{
    Suite *s = suite_create("inputs");
    TCase *t = tcase_create("columns");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, two_logs_with_both_columns_are_needed_to_compare_them);
    tcase_add_test(t, two_logs_are_enough_to_compare_them);
    suite_add_tcase(s, t);
    t = tcase_create("many fits");
    tcase_set_tags(t, "long");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, identify_compares_where_nobody_says_which_column_it_is);
    tcase_add_test(t, a_command_that_acts_late_is_taken_where_what_was_measured_of_it_is_wrong);
    tcase_add_test(t, what_was_measured_is_taken_where_the_command_is_wrong);
    tcase_add_test(t, a_tie_goes_to_what_the_model_says);
    tcase_add_test(t, explain_finds_the_column_before_the_cause);
    tcase_add_test(t, explain_keeps_the_column_that_is_right);
    suite_add_tcase(s, t);
    return s;
}

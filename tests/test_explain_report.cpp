// Reports of explain, on the terminal and as files: what they say, and that they are written whole
// or not at all.
#include "suites.h"

#include <cmath>
#include <cstring>
#include <initializer_list>
#include <string>

#include "mechkit/explain.h"
#include "mechkit/json.h"
#include "support/pendulum.hpp"
extern "C" {
#include "console/commands/explanation.h"
#include "support/files.h"
#include "support/program.h"
}

using namespace made_up;

// What an explanation of no causes looks like; the caller adds to it.
static mk_explanation with_cause(const char *effect, double confidence)
{
    mk_explanation e = {};
    e.given = e.refit = e.extended = pendulum(true);
    e.cause_count = 1;
    e.cause[0].effect = mk_effect_by_name(effect);
    e.cause[0].joint = 1;
    e.cause[0].confidence = confidence;
    e.offered = true;
    e.next.rival = -1;
    return e;
}

static std::string html_of(const mk_explanation &e)
{
    mk_error err = MK_ERROR_INIT;
    mk_log *log = record({}, 1, 1.0);
    const char *path = scratch("claims.html");
    ck_assert_int_eq(mk_explanation_write_html(&e, path, log, &err), MK_OK);
    mk_log_free(log);
    char *text = slurp_file(path);
    const std::string html = text;
    free(text);
    return html;
}

static std::string text_of(const mk_explanation &e)
{
    char *text = nullptr;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    explanation_print(out, &e);
    fclose(out);
    const std::string printed = text;
    free(text);
    return printed;
}

static bool says(const std::string &text, const char *what)
{
    return text.find(what) != std::string::npos;
}

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
        e.offered = offered;
        const std::string text = text_of(e);
        ck_assert_msg(says(text, "explain a part") == offered, "%s", text.c_str());
        ck_assert_msg(!says(text, "but not the held-out data") == offered, "%s", text.c_str());
        ck_assert(says(text, "joint 1: 0 u rms"));
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
        const std::string text = text_of(e);
        ck_assert_msg(!says(text, "same signs, units and columns?") != doubts, "%s", text.c_str());
        ck_assert(mk_explanation_doubts_logs(&e) == doubts);
        e.refitted[0] = 0.1;
    }
}
END_TEST

START_TEST(an_extension_that_leaves_many_times_the_noise_says_so_beside_its_share)
{
    mk_explanation e = with_cause("quadratic-drag", 0.99);
    e.verdict = MK_VERDICT_EFFECT;
    e.budget.item_count = 1;
    e.budget.item[0].log_value = -1;
    e.budget.noise[0] = 1e-4;
    for (const double left : {1.5e-4, 41e-4}) {
        e.budget.extended[0] = left;
        e.budget.closed = 0.9999;
        ck_assert(says(text_of(e), "100 %  41 times the noise") == (left > 1e-3));
        ck_assert(says(text_of(e), "times the noise") == (left > 1e-3));
    }
}
END_TEST

START_TEST(friction_that_is_sharper_or_milder_than_given_is_told)
{
    mk_explanation e = {};
    e.given = e.refit = e.extended = pendulum(true);
    ck_assert(!says(text_of(e), "friction_sharpness") && !says(html_of(e), "friction_sharpness"));
    for (const double times : {16.0, 0.5}) {
        // Of the model that is written, or else of the refitted one.
        for (mk_model *model : {&e.refit, &e.extended}) {
            e.refit = e.extended = e.given;
            model->friction_sharpness = times * e.given.friction_sharpness;
            const char *told = times > 1.0 ? "more sharply than the given model has it: "
                                             "friction_sharpness = 240, given 15 s/rad."
                                           : "less sharply than the given model has it: "
                                             "friction_sharpness = 7.5, given 15 s/rad.";
            ck_assert_msg(says(text_of(e), told), "%s", text_of(e).c_str());
            ck_assert(says(html_of(e), told));
        }
    }
}
END_TEST

// What only a large command meets, a limit say, shows in no other log.
START_TEST(
    held_out_commands_that_are_larger_than_those_to_learn_from_are_told_where_data_are_missed)
{
    mk_explanation e = {};
    e.given = e.refit = e.extended = pendulum(true);
    e.floor[0] = 1e-3;
    for (const double error : {2e-3, 0.1})
        for (const double times : {1.0, 1.8}) {
            e.before[0] = e.refitted[0] = e.after[0] = error;
            e.command_beyond = times;
            const bool told = error > 0.05 && times > 1.5;
            e.process_noise_extended = 1e-3;
            ck_assert(mk_explanation_goes_beyond(&e) == told);
            ck_assert(says(text_of(e), "up to 1.8 times") == told);
            ck_assert(says(html_of(e), "up to 1.8 times") == told);
            // What is missing in the data to learn from as well needs no such reason.
            e.process_noise_extended = 1.0;
            e.trained[0] = error;
            ck_assert(!mk_explanation_goes_beyond(&e));
            e.trained[0] = 0.0;
        }
}
END_TEST

// The verdict `none` says nothing then.
START_TEST(readings_that_are_all_but_noise_are_said_to_be)
{
    mk_explanation e = {};
    e.given = e.refit = e.extended = pendulum(true);
    for (double floor : {0.9, 0.1}) {
        e.floor[0] = floor;
        const std::string text = text_of(e);
        ck_assert_msg(!says(text, "little can be seen in such data") == (floor < 0.5), "%s",
                      text.c_str());
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

START_TEST(a_cause_that_is_not_offered_is_not_called_named)
{
    mk_explanation e = with_cause("quadratic-drag", 0.99);
    e.verdict = MK_VERDICT_UNKNOWN;
    e.offered = false;
    const std::string html = html_of(e);
    ck_assert(!says(html, "named, confidence") &&
              says(html, "not offered: it does not carry over"));
    ck_assert(!says(html, "The formula is in extended.ini"));
    // Where there is no formula either, it is not said to be in the model.
    e.cause_count = 0;
    ck_assert(!says(html_of(e), "The formula is in extended.ini"));
    e.cause_count = 1;
    e.offered = true;
    ck_assert(says(html_of(e), "named, confidence 0.990"));
}
END_TEST

START_TEST(a_cause_that_a_rival_equals_is_named_with_it)
{
    mk_explanation e = with_cause("base-compliance", 0.002);
    e.verdict = MK_VERDICT_PARTIAL;
    e.rival_count = 1;
    e.rival[0].effect = mk_effect_by_name("cogging");
    e.rival[0].joint = 1;
    e.rival[0].delta_bic = -12.9;
    const std::string html = html_of(e);
    ck_assert(says(html, "base-compliance at joint 1 or cogging at joint 1; that is a part"));
    ck_assert(says(html, "12.9 apart") && !says(html, "-12.9"));
    ck_assert(says(html, "one of several that these data do not tell apart, confidence 0.002"));
}
END_TEST

START_TEST(what_is_refused_is_said_in_the_unit_of_the_table)
{
    mk_explanation e = with_cause("quadratic-drag", 0.99);
    e.verdict = MK_VERDICT_UNKNOWN;
    e.offered = false;
    e.refitted[0] = 0.25, e.declined[0] = 0.5, e.budget.refit[0] = 0.0628;
    ck_assert(says(text_of(e), "would leave 126 mrad at joint 1 where refitting leaves 62.8."));
}
END_TEST

START_TEST(a_small_rest_is_called_small)
{
    mk_explanation e = with_cause("quadratic-drag", 0.99);
    e.verdict = MK_VERDICT_PARTIAL;
    for (const bool small : {true, false}) {
        e.budget.closed = small ? 0.99 : 0.6;
        ck_assert(says(text_of(e), "a small rest has none") == small);
        ck_assert(says(html_of(e), "a small rest has no name") == small);
    }
}
END_TEST

START_TEST(a_value_that_was_not_given_is_not_listed_as_given)
{
    mk_explanation e = {};
    e.given = e.refit = e.extended = pendulum(true);
    e.verdict = MK_VERDICT_PARAMETERS;
    e.unknown[1] = true;
    ck_assert(says(html_of(e), "</td><td>?</td>"));
    ck_assert(says(text_of(e), "p2: given ?, refitted 6.9") && says(text_of(e), "p1: given 0.06"));
}
END_TEST

START_TEST(a_mass_that_is_far_from_what_was_given_is_doubted)
{
    mk_explanation e = with_cause("quadratic-drag", 0.99);
    for (const double times : {0.1, 0.5, 2.0, 10.0, -1.0}) {
        const bool far = times < 0.4 || times > 3.0;
        e.extended.parameter[0] = times * e.given.parameter[0];
        e.verdict = MK_VERDICT_PARTIAL;
        ck_assert(says(text_of(e), "p1 is fitted as") == far);
        ck_assert(says(html_of(e), "p1 is far from what was given") == far);
        e.verdict = MK_VERDICT_EFFECT;
        ck_assert(!says(text_of(e), "p1 is fitted as"));
    }
    e.verdict = MK_VERDICT_PARTIAL;
    e.unknown[0] = true;
    ck_assert(!says(text_of(e), "p1 is fitted as"));
}
END_TEST

START_TEST(a_belief_that_never_held_has_no_figures)
{
    mk_explanation e = with_cause("quadratic-drag", 0.99);
    e.verdict = MK_VERDICT_EFFECT;
    e.control_count = 1;
    e.control[0].setup = "pendubot-mid";
    e.control[0].runs = 5;
    e.control[0].given.error = e.control[0].given.effort = std::nan("");
    e.control[0].refit = e.control[0].extended = e.control[0].given;
    ck_assert(!says(text_of(e), "nan"));
}
END_TEST

START_TEST(what_is_an_angle_everywhere_is_in_rad_on_a_slide)
{
    mk_model m;
    mk_model_default(MK_PLANT_CART_POLE, &m);
    const mk_effect_info *tilt = mk_effect_by_name("base-tilt"),
                         *cogging = mk_effect_by_name("cogging");
    ck_assert_str_eq(mk_effect_parameter_unit(&m, 0, &tilt->parameter[0]), "rad");
    const int phase = mk_effect_parameter_index(cogging, "phase");
    ck_assert_str_eq(mk_effect_parameter_unit(&m, 1, &cogging->parameter[phase]), "rad");
    const mk_effect_info *offset = mk_effect_by_name("encoder-offset");
    ck_assert_str_eq(mk_effect_parameter_unit(&m, 1, &offset->parameter[0]), "m");
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
    ck_assert_int_eq(explain(log, ""), 2);
    ck_assert_msg(strstr(out, "still.csv: that is a file to be read") != nullptr, "%s", out);
    ck_assert_int_eq(explain(scratch_text("taken", ""), ""), 1);
    ck_assert_msg(strstr(out, "taken: this is no folder") != nullptr, "%s", out);
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

// A pendulum at `path`, and a log of it beside.
static void write_rig_and_log(const char *path, char (&model)[512], char (&log)[512])
{
    mk_error err = MK_ERROR_INIT;
    const mk_model rig = pendulum(false);
    mk_log *data = record({}, 0, 3.0);
    snprintf(model, sizeof model, "%s", path);
    snprintf(log, sizeof log, "%s", scratch("run.csv"));
    ck_assert_int_eq(mk_model_write(model, &rig, nullptr, &err), MK_OK);
    ck_assert_int_eq(mk_log_write(log, data, &err), MK_OK);
    mk_log_free(data);
}

START_TEST(a_fit_writes_over_no_log_and_says_first_what_it_cannot_write)
{
    char out[2048], model[512], log[512];
    write_rig_and_log(scratch("rig.ini"), model, log);
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

START_TEST(a_second_search_in_the_folder_of_the_first_keeps_the_model_that_it_is_given)
{
    char out[2048], model[512], log[512];
    write_rig_and_log(scratch("extended.ini"), model, log);
    char *before = slurp_file(model);
    char folder[512];
    snprintf(folder, sizeof folder, "%.*s", (int)(strrchr(model, '/') - model), model);
    ck_assert_int_eq(
        run_mechkit(out, sizeof out, "explain --model %s --out %s %s", model, folder, log), 2);
    ck_assert_msg(strstr(out, "extended.ini there is the model to be read") != nullptr, "%s", out);
    char *after = slurp_file(model);
    ck_assert_str_eq(after, before);
    free(before);
    free(after);
}
END_TEST

Suite *suite_explain_report(void)
{
    Suite *s = suite_create("explain_report");
    TCase *t = tcase_create("reports");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, the_reports_say_what_was_found);
    tcase_add_test(t, whole_numbers_have_no_standard_error);
    tcase_add_test(t, a_formula_that_is_not_offered_is_not_said_to_explain_a_part);
    tcase_add_test(t, logs_that_do_not_go_with_the_held_out_ones_are_doubted);
    tcase_add_test(t, readings_that_are_all_but_noise_are_said_to_be);
    tcase_add_test(t, values_that_were_wrong_are_listed_with_those_of_given_effects);
    tcase_add_test(t, a_cause_that_is_not_offered_is_not_called_named);
    tcase_add_test(t, a_cause_that_a_rival_equals_is_named_with_it);
    tcase_add_test(t, what_is_refused_is_said_in_the_unit_of_the_table);
    tcase_add_test(t, a_small_rest_is_called_small);
    tcase_add_test(t, a_value_that_was_not_given_is_not_listed_as_given);
    tcase_add_test(
        t,
        held_out_commands_that_are_larger_than_those_to_learn_from_are_told_where_data_are_missed);
    tcase_add_test(t, friction_that_is_sharper_or_milder_than_given_is_told);
    tcase_add_test(t, an_extension_that_leaves_many_times_the_noise_says_so_beside_its_share);
    tcase_add_test(t, a_mass_that_is_far_from_what_was_given_is_doubted);
    tcase_add_test(t, a_belief_that_never_held_has_no_figures);
    tcase_add_test(t, what_is_an_angle_everywhere_is_in_rad_on_a_slide);
    tcase_add_test(t, a_report_that_could_not_be_written_is_not_made);
    tcase_add_test(t, a_report_is_written_whole_or_not_at_all);
    tcase_add_test(t, a_search_that_is_ended_leaves_no_folder);
    tcase_add_test(t, a_fit_writes_over_no_log_and_says_first_what_it_cannot_write);
    tcase_add_test(t, a_second_search_in_the_folder_of_the_first_keeps_the_model_that_it_is_given);
    suite_add_tcase(s, t);
    return s;
}

// Somebody's hand in a log: found where it is, and nowhere else. The truth is the simulator of
// support/truth.hpp, which has a formulation of its own.
#include "suites.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "ident/contact.hpp"
#include "mechkit/explain.h"
#include "mechkit/ident.h"
#include "mechkit/json.h"
#include "support/cases.hpp"
extern "C" {
#include "support/files.h"
#include "support/program.h"
}

namespace
{

constexpr double NEAR_ENOUGH = 0.3; // s

const char *const rigs[] = {"inertia-wheel", "pendulum", "pendubot", "reaction-wheel", "furuta"};
enum Place { START, MIDDLE, END };

// A rig, its model, and three logs of it; the model's parameters are up to 20 % off.
truth::Case made(const char *rig, const char *effect, uint64_t seed)
{
    truth::Wish wish;
    wish.rig = rig;
    wish.kind = effect ? "single" : "parameters";
    wish.effect = effect ? effect : "";
    wish.seed = seed;
    wish.runs = 3;
    wish.seconds = 8.0;
    return truth::make_case(wish);
}

std::vector<mk_record> records_of(const truth::Case &c)
{
    std::vector<mk_record> records;
    mk_error err = MK_ERROR_INIT;
    for (const truth::OwnedLog *log : {&c.train[0], &c.train[1], &c.holdout}) {
        mk_record record;
        ck_assert_msg(mk_record_from_log(log->get(), &c.given, &record, &err) == MK_OK, "%s",
                      err.message);
        records.push_back(record);
    }
    return records;
}

// A hand that takes joint 1 some way off from where it would be, and holds it there.
truth::Effect hand_at(const truth::Case &c, double from, double to)
{
    constexpr double STIFF = 25.0; // rad/s: as fast as a hand moves the joint
    const double inertia = c.rig.p[0];
    const truth::Log free = truth::record(c.rig, c.how[0]);
    const size_t row = (size_t)(from * c.how[0].rate);
    return {"hand",
            1,
            {{"from", from},
             {"to", to},
             {"place", free.angle[0][row] + 0.6},
             {"rate", 0.0},
             {"stiffness", inertia * STIFF * STIFF},
             {"damping", 1.4 * inertia * STIFF}}};
}

void touch(truth::Case &c, const truth::Effect &what)
{
    truth::Rig rig = c.rig;
    rig.effects.push_back(what);
    c.train[0] = truth::as_log(truth::record(rig, c.how[0]), rig, c.how[0]);
}

void check_found(const truth::Case &c, double from, double to)
{
    const std::vector<mk_record> records = records_of(c);
    const std::vector<mk::Contact> found = mk::find_contacts(c.given, records);
    const double end = records[0].t[records[0].rows - 1] - records[0].t[0];
    ck_assert_msg(found.size() == 1, "%s: %zu found", c.rig.kind.c_str(), found.size());
    ck_assert_uint_eq(found[0].log, 0);
    ck_assert_double_eq_tol(found[0].from_s, from, NEAR_ENOUGH);
    ck_assert_double_eq_tol(std::fmin(found[0].to_s, end), std::fmin(to, end), NEAR_ENOUGH);
}

} // namespace

START_TEST(a_hand_is_found_at_the_start_in_the_middle_and_at_the_end)
{
    const double spans[][2] = {{0.0, 0.8}, {3.5, 4.4}, {7.1, 9.0}};
    for (Place place : {START, MIDDLE, END}) {
        truth::Case c = made(rigs[_i], nullptr, 71);
        const double *span = spans[place];
        touch(c, hand_at(c, span[0], span[1]));
        check_found(c, span[0], span[1]);
    }
}
END_TEST

START_TEST(a_kick_is_found)
{
    truth::Case c = made("furuta", nullptr, 5);
    touch(c, {"kick", 1, {{"from", 4.0}, {"to", 4.06}, {"level", 400.0 * c.rig.p[0]}}});
    check_found(c, 4.0, 4.06);
}
END_TEST

START_TEST(parameters_that_are_far_off_change_nothing)
{
    for (double factor : {1.3, 3.0, 1.0 / 3.0}) {
        truth::Case c = made("pendubot", nullptr, 12);
        touch(c, hand_at(c, 0.0, 0.8));
        for (int i = 0; i < mk_plant(c.given.plant)->parameter_count; i++)
            c.given.parameter[i] *= i % 2 ? factor : 1.0;
        check_found(c, 0.0, 0.8);
    }
}
END_TEST

// As one that is switched off, in spite of the command that is logged.
START_TEST(a_log_that_stands_still_hides_no_hand_in_another)
{
    truth::Case c = made("pendulum", nullptr, 71);
    touch(c, hand_at(c, 3.5, 4.4));
    mk_log *still = c.train[1].get();
    for (size_t column = 0; column < still->column_count; column++)
        if (strcmp(still->columns[column].name, "q1") == 0)
            std::fill_n(still->columns[column].data, still->rows, 0.0);
    check_found(c, 3.5, 4.4);
}
END_TEST

START_TEST(a_rig_alone_is_not_touched)
{
    for (uint64_t seed = 300; seed < 303; seed++) {
        const truth::Case c = made(rigs[_i], nullptr, seed);
        ck_assert_uint_eq(mk::find_contacts(c.given, records_of(c)).size(), 0);
    }
}
END_TEST

// Tumbling that the smoother of the readings cannot follow, the ends of logs, where it knows one
// side only, and a swing that comes to rest, which is most of the log and the least of the motion.
START_TEST(what_a_smoother_cannot_follow_is_no_hand)
{
    const struct {
        const char *rig;
        uint64_t seed;
        double seconds;
    } rows[] = {{"pendubot", 8800142, 19.0},
                {"pendubot", 8800262, 29.0},
                {"pendulum", 8800226, 17.0},
                {"pendulum", 8800236, 0.0}};
    truth::Wish wish;
    wish.rig = rows[_i].rig;
    wish.kind = "parameters";
    wish.seed = rows[_i].seed;
    wish.runs = rows[_i].seconds > 0.0 ? 3 : 0;
    wish.seconds = rows[_i].seconds;
    const truth::Case c = truth::make_case(wish);
    const std::vector<mk_record> records = records_of(c);
    ck_assert_uint_eq(mk::find_contacts(c.given, records).size(), 0);
    for (const mk_record &alone : records)
        ck_assert_uint_eq(mk::find_contacts(c.given, {alone}).size(), 0);
}
END_TEST

// A measured swing-up beside slow motions: what its textbook misses is out of proportion to theirs,
// and yet it is predicted.
START_TEST(a_fast_swing_among_slow_ones_is_no_hand)
{
    mk_model model;
    mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_model_read("models/measured/double-pendulum-dfki-c1.ini", &model, &err),
                     MK_OK);
    std::vector<truth::OwnedLog> logs;
    std::vector<mk_record> records;
    for (const char *run : {"run_143339", "run_154220"}) {
        logs.emplace_back(measured_log("pendubot-dfki-c1-sysid", run, "double-pendulum-dfki"));
        if (!logs.back())
            return;
        records.emplace_back();
        ck_assert_int_eq(mk_record_from_log(logs.back().get(), &model, &records.back(), &err),
                         MK_OK);
    }
    ck_assert_uint_eq(mk::find_contacts(model, records).size(), 0);
}
END_TEST

// A rig that hangs still until its motor starts: what the smoother makes of the start is large
// beside the little that a right model leaves elsewhere.
START_TEST(a_start_from_rest_is_no_hand_to_a_right_model)
{
    const char *path = shared_path("challenge_rich/case_012/holdout_1.csv.gz");
    mk_model model;
    mk_log *read = nullptr;
    mk_record record;
    mk_error err = MK_ERROR_INIT;
    if (!path) {
        fprintf(stderr, "skipped: no challenge_rich/case_012\n");
        return;
    }
    ck_assert_int_eq(mk_log_read(path, &read, &err), MK_OK);
    const truth::OwnedLog log(read);
    const char *ini = scratch_text(
        "right.ini", "[rig]\nkind = pendubot\nu_to_torque = 0.00494\nencoder_cpr = 4000 8192\n"
                     "[parameters]\np1 = 0.061319777526869804\np2 = 0.04895255765057806\np3 = "
                     "0.03016190826330335\n"
                     "p4 = 0.7453608073241398\np5 = 0.3271273496680311\np6 = "
                     "0.1453381686365383\np7 = 0.2132999829107231\n"
                     "[effect.viscous]\njoint = 2\ncoefficient = 0.006468979731963378\n"
                     "[effect.cogging]\njoint = 1\namplitude = 0.018404602500143183\ncycles = 7\n"
                     "phase = -0.39777192263741773\n[effect.encoder-scale]\njoint = 2\n"
                     "ratio = 0.00913285211526067\n[effect.load-friction]\njoint = 2\n"
                     "coefficient = 0.0018290880296059253\n");
    ck_assert_msg(mk_model_read(ini, &model, &err) == MK_OK, "%s", err.message);
    ck_assert_int_eq(mk_record_from_log(log.get(), &model, &record, &err), MK_OK);
    ck_assert_uint_eq(mk::find_contacts(model, {record}).size(), 0);
}
END_TEST

START_TEST(rows_that_were_not_asked_for_are_marked_and_have_no_angles)
{
    const truth::Case c = made("pendulum", nullptr, 71);
    const mk_log *log = c.train[0].get();
    mk_row_choice choice = {1.0, 6.0, false};
    std::vector<mk_left_out> found(MK_MAX_LEFT_OUT);
    int count = 0;
    mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_find_left_out(&c.given, &log, 1, &choice, found.data(), &count, &err),
                     MK_OK);
    ck_assert_int_eq(count, 2);
    mk_log *copy = nullptr;
    ck_assert_int_eq(mk_leave_out(log, 0, found.data(), count, &copy, &err), MK_OK);
    const truth::OwnedLog owned(copy);
    const double *t = mk_log_get(log, "t"), *mark = mk_log_get(copy, "left_out");
    for (size_t k = 0; k < log->rows; k++) {
        const bool asked = t[k] - t[0] > 1.0 - 1e-6 && t[k] - t[0] < 6.0 + 1e-6;
        ck_assert_msg((mark[k] == 0.0) == asked, "row %zu, %g s", k, t[k] - t[0]);
        ck_assert(asked || std::isnan(mk_log_get(copy, "q1")[k]));
        ck_assert(!asked || mk_log_get(copy, "u")[k] == mk_log_get(log, "u")[k]);
    }
    choice = {100.0, 0.0, false};
    ck_assert_int_eq(mk_find_left_out(&c.given, &log, 1, &choice, found.data(), &count, &err),
                     MK_ERR_RANGE);
}
END_TEST

// With the hand in it the fit is far off, without it as good as of a log without one.
START_TEST(a_fit_leaves_a_hand_out)
{
    truth::Case c = made("pendubot", nullptr, 12);
    touch(c, hand_at(c, 3.5, 4.4));
    const mk_log *log = c.train[0].get();
    double worst[2];
    for (bool keep : {false, true}) {
        auto r = std::make_unique<mk_ident_result>();
        mk_ident_options options = {};
        options.rows.keep_all = keep;
        mk_error err = MK_ERROR_INIT;
        const enum mk_status st = mk_identify(&c.given, &log, 1, &options, r.get(), &err);
        ck_assert_msg(st == MK_OK || keep, "%s", err.message);
        ck_assert(st != MK_OK || r->left_out_count == (keep ? 0 : 1));
        worst[keep] = st == MK_OK ? 0.0 : HUGE_VAL;
        for (size_t i = 0; i < c.rig.p.size() && st == MK_OK; i++)
            worst[keep] =
                std::fmax(worst[keep], std::fabs(r->model.parameter[i] / c.rig.p[i] - 1.0));
    }
    ck_assert_double_lt(worst[false], 0.03);
    ck_assert_double_gt(worst[true], 3.0 * worst[false]);
}
END_TEST

enum Subcommand { SIMULATE, IDENTIFY, EXPLAIN, SUBCOMMANDS };

// The files of one run of a subcommand on a pendulum's logs, the first touched from 0 to 0.8 s.
struct Told {
    char out[16384], made_file[512], model[512], log[512];
    cJSON *figures = nullptr;

    Told(int subcommand, const char *more)
    {
        truth::Case c = made("pendulum", nullptr, 71);
        mk_error err = MK_ERROR_INIT;
        touch(c, hand_at(c, 0.0, 0.8));
        snprintf(model, sizeof model, "%s", scratch("touched.ini"));
        snprintf(log, sizeof log, "%s", scratch("touched.csv"));
        snprintf(made_file, sizeof made_file, "%s", scratch("told"));
        ck_assert_int_eq(mk_model_write(model, &c.given, nullptr, &err), MK_OK);
        ck_assert_int_eq(mk_log_write(log, c.train[0].get(), &err), MK_OK);
        const int code = run(subcommand, more);
        ck_assert_msg(code == 0, "%s", out);
        if (subcommand == EXPLAIN)
            snprintf(made_file, sizeof made_file, "%s/report.json", scratch("report"));
        ck_assert_int_eq(mk_json_read(made_file, &figures, &err), MK_OK);
    }
    ~Told() { cJSON_Delete(figures); }
    const cJSON *left_out() const { return cJSON_GetObjectItem(figures, "left_out"); }
    double number(const char *name) const
    {
        return cJSON_GetObjectItem(cJSON_GetArrayItem(left_out(), 0), name)->valuedouble;
    }

  private:
    int run(int subcommand, const char *more)
    {
        if (subcommand == SIMULATE)
            return run_mechkit(out, sizeof out,
                               "simulate --window 1 --model %s --input %s --json %s %s", model, log,
                               made_file, more);
        if (subcommand == IDENTIFY)
            return run_mechkit(out, sizeof out, "identify --model %s --json %s %s %s", model,
                               made_file, more, log);
        return run_mechkit(out, sizeof out, "explain --model %s --out %s %s %s", model,
                           scratch("report"), more, log);
    }
};

START_TEST(what_is_left_out_is_told_by_output_and_json)
{
    const Told told(_i, "");
    ck_assert_msg(strstr(told.out, "are left out: a torque of up to") &&
                      strstr(told.out, "(--keep-all keeps them)") &&
                      strstr(told.out, "s (foreign contact at joint 1)"),
                  "%s", told.out);
    ck_assert_int_eq(cJSON_GetArraySize(told.left_out()), 1);
    ck_assert_str_eq(
        cJSON_GetObjectItem(cJSON_GetArrayItem(told.left_out(), 0), "file")->valuestring, told.log);
    ck_assert_double_eq_tol(told.number("from_s"), 0.0, NEAR_ENOUGH);
    ck_assert_double_eq_tol(told.number("to_s"), 0.8, NEAR_ENOUGH);
    ck_assert_double_eq(told.number("joint"), 1.0);
    if (_i != EXPLAIN)
        return;
    const std::unique_ptr<char, decltype(&free)> html(slurp_file(scratch("report/report.html")),
                                                      free);
    ck_assert_ptr_nonnull(strstr(html.get(), "<rect class='left-out' x='0.0'"));
    ck_assert_ptr_nonnull(strstr(html.get(), "hand, or a collision?"));
}
END_TEST

START_TEST(all_is_kept_or_a_part_taken_where_that_is_asked_for)
{
    const Told kept(_i, "--keep-all");
    ck_assert_int_eq(cJSON_GetArraySize(kept.left_out()), 0);
    ck_assert_ptr_null(strstr(kept.out, "foreign"));
    const Told part(_i, "--from 1 --to 7.5");
    ck_assert_int_eq(cJSON_GetArraySize(part.left_out()), 2);
    ck_assert_double_eq_tol(part.number("to_s"), 1.0, 1e-6);
    ck_assert_ptr_null(cJSON_GetObjectItem(cJSON_GetArrayItem(part.left_out(), 0), "joint"));
    ck_assert_ptr_null(strstr(part.out, "foreign"));
}
END_TEST

START_TEST(an_effect_that_the_model_lacks_is_no_hand)
{
    const char *const effects[] = {"stiction", "end-stop",   "backlash",   "missed-counts",
                                   "deadband", "saturation", "input-delay"};
    const truth::Case c = made("furuta", effects[_i], 44);
    ck_assert_uint_eq(mk::find_contacts(c.given, records_of(c)).size(), 0);
}
END_TEST

START_TEST(a_hand_that_is_kept_is_not_taken_for_explained)
{
    // The refitted model predicts the log held out, where nobody was, and misses the one with the
    // hand by far.
    truth::Case c = made("inertia-wheel", nullptr, 13);
    touch(c, hand_at(c, 3.5, 4.4));
    std::vector<const mk_log *> train;
    for (const truth::OwnedLog &log : c.train)
        train.push_back(log.get());
    const mk_log *hold = c.holdout.get();
    mk_explain_options o = {};
    o.threads = 2;
    o.rows.keep_all = true;
    static mk_explanation e;
    mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_explain(&c.given, train.data(), train.size(), &hold, 1, &o, &e, &err) == MK_OK,
                  "%s", err.message);
    ck_assert_str_eq(mk_verdict_name(e.verdict), "unknown");
}
END_TEST

Suite *suite_contact(void)
{
    Suite *s = suite_create("contact");
    TCase *t = tcase_create("contact");
    tcase_set_timeout(t, 120);
    tcase_add_loop_test(t, a_hand_is_found_at_the_start_in_the_middle_and_at_the_end, 0, 1);
    tcase_add_test(t, a_kick_is_found);
    tcase_add_loop_test(t, a_rig_alone_is_not_touched, 0, 1);
    tcase_add_loop_test(t, what_a_smoother_cannot_follow_is_no_hand, 0, 1);
    tcase_add_test(t, a_fast_swing_among_slow_ones_is_no_hand);
    tcase_add_test(t, a_start_from_rest_is_no_hand_to_a_right_model);
    tcase_add_test(t, rows_that_were_not_asked_for_are_marked_and_have_no_angles);
    tcase_add_loop_test(t, what_is_left_out_is_told_by_output_and_json, 0, SUBCOMMANDS);
    tcase_add_loop_test(t, all_is_kept_or_a_part_taken_where_that_is_asked_for, 0, EXPLAIN);
    tcase_add_loop_test(t, an_effect_that_the_model_lacks_is_no_hand, 0, 1);
    suite_add_tcase(s, t);
    t = tcase_create("other rigs");
    tcase_set_timeout(t, 300);
    tcase_set_tags(t, "long");
    tcase_add_test(t, a_fit_leaves_a_hand_out);
    tcase_add_test(t, a_hand_that_is_kept_is_not_taken_for_explained);
    tcase_add_test(t, parameters_that_are_far_off_change_nothing);
    tcase_add_test(t, a_log_that_stands_still_hides_no_hand_in_another);
    tcase_add_loop_test(t, a_hand_is_found_at_the_start_in_the_middle_and_at_the_end, 1, 5);
    tcase_add_loop_test(t, a_rig_alone_is_not_touched, 1, 5);
    tcase_add_loop_test(t, what_a_smoother_cannot_follow_is_no_hand, 1, 4);
    tcase_add_loop_test(t, an_effect_that_the_model_lacks_is_no_hand, 1, 7);
    suite_add_tcase(s, t);
    return s;
}

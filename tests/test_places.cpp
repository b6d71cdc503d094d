// Where counters were zeroed: logs of one rig whose wheel or arm stood elsewhere each time. Data
// are those of an independent simulator.
#include "explain/search/places.hpp"

#include <cmath>
#include <cstring>
#include <memory>
#include <vector>

#include "explain/report/places_text.h"
#include "mechkit/explain.h"
#include "suites.h"
#include "support/cases.hpp"

namespace
{

constexpr double TURN = 2.0 * M_PI;
// Where the counter of joint 1 stands when it is zeroed, in counts of 4000 a turn.
constexpr double elsewhere[] = {0.0, 1234.0, 3021.0, 555.0};

// Logs of a usual rig with one effect, the last one held out, their counters zeroed at these
// places.
struct Logs {
    std::vector<truth::OwnedLog> logs;
    mk_model given;

    Logs(enum mk_plant_kind kind, const truth::Effect &effect, const double *counts)
    {
        mk_model_default(kind, &given);
        for (int k = 0; k < 4; k++) {
            logs.push_back(truth::usual_log(kind, {effect}, 11 + (uint64_t)k));
            mk_log &log = *logs.back();
            for (size_t c = 0; c < log.column_count; c++)
                if (std::strcmp(log.columns[c].name, "q1") == 0)
                    for (size_t i = 0; i < log.rows; i++)
                        log.columns[c].data[i] -= counts[k] * TURN / 4000.0;
        }
    }
    std::unique_ptr<mk_explanation> explained() const
    {
        std::vector<const mk_log *> all;
        for (const truth::OwnedLog &log : logs)
            all.push_back(log.get());
        mk_error err = MK_ERROR_INIT;
        mk_explain_options options = {};
        options.threads = 2;
        auto e = std::make_unique<mk_explanation>();
        const enum mk_status st =
            mk_explain(&given, all.data(), 3, &all[3], 1, &options, e.get(), &err);
        ck_assert_msg(st == MK_OK, "%s", err.message);
        return e;
    }
};

void check_found(const mk_explanation &e, const char *effect, double cycles)
{
    ck_assert_int_eq(e.places.joint, 1);
    ck_assert_str_eq(e.places.by->name, effect);
    ck_assert_double_eq(e.places.cycles, cycles);
    ck_assert_int_eq(e.places.learned, 3);
    ck_assert_int_eq(e.places.count, 4);
    for (int k = 0; k < 4; k++) {
        // But for multiples of a cycle.
        const double off = elsewhere[k] * TURN / 4000.0 - e.places.shift[k];
        ck_assert_double_le(std::fabs(std::remainder(off, TURN / cycles)),
                            5.0 * e.places.std_error[k] + 2e-4);
    }
    ck_assert_int_eq(e.verdict, MK_VERDICT_EFFECT);
    ck_assert_str_eq(e.cause[0].effect->name, effect);
}

START_TEST(cogging_is_found_though_every_log_was_zeroed_elsewhere)
{
    const truth::Effect cogging = {
        "cogging", 1, {{"amplitude", 0.1}, {"cycles", 7.0}, {"phase", 0.8}}};
    const Logs logs(MK_PLANT_INERTIA_WHEEL, cogging, elsewhere);
    const std::unique_ptr<mk_explanation> e = logs.explained();
    check_found(*e, "cogging", 7.0);
    ck_assert_double_eq_tol(e->cause[0].value[0], 0.1, 1e-3);
    char text[4096];
    mk_places_sentence(e.get(), text, sizeof text);
    ck_assert_ptr_nonnull(std::strstr(text, "the counter of joint 1 was zeroed elsewhere"));
    ck_assert_ptr_nonnull(std::strstr(text, "log 3"));
    ck_assert_ptr_nonnull(std::strstr(text, "hold-out 1"));
}
END_TEST

START_TEST(so_is_a_ripple_under_an_arm_that_turns_level)
{
    const truth::Effect ripple = {
        "torque-ripple", 0, {{"ratio", 0.1}, {"cycles", 4.0}, {"phase", 0.3}}};
    check_found(*Logs(MK_PLANT_FURUTA, ripple, elsewhere).explained(), "torque-ripple", 4.0);
}
END_TEST

START_TEST(logs_with_one_zero_are_left_where_they_are)
{
    const double same[] = {0.0, 0.0, 0.0, 0.0};
    const truth::Effect cogging = {
        "cogging", 1, {{"amplitude", 0.1}, {"cycles", 7.0}, {"phase", 0.8}}};
    const std::unique_ptr<mk_explanation> e =
        Logs(MK_PLANT_INERTIA_WHEEL, cogging, same).explained();
    ck_assert_int_eq(e->places.joint, 0);
    ck_assert_str_eq(e->cause[0].effect->name, "cogging");
}
END_TEST

START_TEST(a_place_that_logs_have_in_common_is_not_taken_from_them)
{
    const double same[] = {0.0, 0.0, 0.0, 0.0};
    const truth::Effect cable = {"cable-stiffness", 1, {{"stiffness", 0.3}, {"rest", 0.1}}};
    const std::unique_ptr<mk_explanation> e = Logs(MK_PLANT_FURUTA, cable, same).explained();
    ck_assert_int_eq(e->places.joint, 0);
    ck_assert_str_eq(e->cause[0].effect->name, "cable-stiffness");
}
END_TEST

} // namespace

Suite *suite_places(void)
{
    Suite *s = suite_create("places");
    TCase *t = tcase_create("places");
    tcase_set_timeout(t, 120.0);
    tcase_add_test(t, cogging_is_found_though_every_log_was_zeroed_elsewhere);
    suite_add_tcase(s, t);
    TCase *more = tcase_create("more places");
    tcase_set_timeout(more, 120.0);
    tcase_set_tags(more, "long");
    tcase_add_test(more, so_is_a_ripple_under_an_arm_that_turns_level);
    tcase_add_test(more, logs_with_one_zero_are_left_where_they_are);
    tcase_add_test(more, a_place_that_logs_have_in_common_is_not_taken_from_them);
    suite_add_tcase(s, more);
    return s;
}

// Somebody's hand in a log: found where it is, and nowhere else. The truth is the simulator of
// support/truth.hpp, which has a formulation of its own.
#include "suites.h"

#include <cmath>
#include <vector>

#include "ident/contact.hpp"
#include "support/cases.hpp"

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

START_TEST(a_rig_alone_is_not_touched)
{
    for (uint64_t seed = 300; seed < 303; seed++) {
        const truth::Case c = made(rigs[_i], nullptr, seed);
        ck_assert_uint_eq(mk::find_contacts(c.given, records_of(c)).size(), 0);
    }
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

Suite *suite_contact(void)
{
    Suite *s = suite_create("contact");
    TCase *t = tcase_create("contact");
    tcase_set_timeout(t, 120);
    tcase_add_loop_test(t, a_hand_is_found_at_the_start_in_the_middle_and_at_the_end, 0, 5);
    tcase_add_test(t, a_kick_is_found);
    tcase_add_test(t, parameters_that_are_far_off_change_nothing);
    tcase_add_loop_test(t, a_rig_alone_is_not_touched, 0, 5);
    tcase_add_loop_test(t, an_effect_that_the_model_lacks_is_no_hand, 0, 7);
    suite_add_tcase(s, t);
    return s;
}

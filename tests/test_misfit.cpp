// What identify says of a model that does not follow its data, and where its fit ends then.
#include "suites.h"

#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "mechkit/exchange.h"
#include "mechkit/ident.h"
#include "mechkit/sim.h"
#include "support/cases.hpp"
#include "support/files.h"
#include "support/program.h"

namespace
{

std::unique_ptr<mk_ident_result> fit(const mk_model &m, const std::vector<const mk_log *> &logs)
{
    auto r = std::make_unique<mk_ident_result>();
    mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_identify(&m, logs.data(), logs.size(), nullptr, r.get(), &err) == MK_OK, "%s",
                  err.message);
    return r;
}

bool warns(const mk_ident_result &r, const char *of)
{
    for (int i = 0; i < r.warning_count; i++)
        if (strstr(r.warning[i], of))
            return true;
    return false;
}

// Mean over the logs' free runs of 0.5 s, joints together.
double error_of(const mk_model &m, const std::vector<const mk_log *> &logs)
{
    double sum = 0.0;
    for (const mk_log *log : logs) {
        mk_predict_options o = {};
        o.window_s = 0.5;
        mk_predict_figures figures;
        mk_log *made = nullptr;
        ck_assert_int_eq(mk_predict(&m, log, &o, &made, &figures, nullptr, nullptr), MK_OK);
        mk_log_free(made);
        for (int j = 0; j < mk_model_joints(&m); j++)
            sum += figures.nrmse[j];
    }
    return sum;
}

mk_effect_use &add(mk_model &m, const char *effect, int joint)
{
    ck_assert_int_eq(mk_model_add_effect(&m, effect, joint, nullptr), MK_OK);
    return m.effect[m.effect_count - 1];
}

} // namespace

START_TEST(a_model_that_misses_something_is_told_how_much)
{
    const truth::OwnedLog log = truth::usual_log(
        MK_PLANT_PENDULUM, {{"cogging", 1, {{"amplitude", 0.1}, {"cycles", 4.0}, {"phase", 0.7}}}},
        61);
    mk_model m;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    const auto r = fit(m, {log.get()});
    ck_assert_msg(warns(*r, "of the motion, far more than the readings' noise"), "%s",
                  r->warning_count ? r->warning[0] : "no warning");
    ck_assert(!warns(*r, "is it this rig"));
}
END_TEST

START_TEST(data_of_another_rig_are_asked_about)
{
    // An angle that no pendulum goes through.
    const truth::OwnedLog log = truth::usual_log(MK_PLANT_PENDULUM, {}, 61);
    double *q = const_cast<double *>(mk_log_get(log.get(), "q1"));
    const double *t = mk_log_get(log.get(), "t");
    for (size_t k = 0; k < log->rows; k++)
        q[k] = std::copysign(0.5, std::sin(9.0 * t[k])) + 0.1 * std::sin(31.0 * t[k]);
    mk_model m;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    const mk_log *one = log.get();
    auto r = std::make_unique<mk_ident_result>();
    mk_error err = MK_ERROR_INIT;
    const enum mk_status st = mk_identify(&m, &one, 1, nullptr, r.get(), &err);
    ck_assert(st == MK_OK ? warns(*r, "is it this rig")
                          : strstr(err.message, "is it this rig") != nullptr);
}
END_TEST

// A model with two cables of a balanced Furuta pendulum follows its free runs, and no reading in a
// hundred: likelihood alone ended in a noise of 0.26 rad.
START_TEST(a_fit_does_not_leave_measured_data_that_its_start_follows)
{
    const char *episodes[] = {"ep_150615", "ep_161441"};
    mk_model m;
    mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk_model_read("models/measured/furuta-qube-servo1.ini", &m, &err), MK_OK);
    const double base[] = {0.064183, 0.0627011, 0.00758693, 2.1439, 0.0243214, 0.0856369};
    std::copy(std::begin(base), std::end(base), m.parameter);
    mk_effect_use &second = add(m, "cable-hysteresis", 2);
    second.value[0] = 17.4089, second.value[1] = 1.70791;
    mk_effect_use &first = add(m, "cable-hysteresis", 1);
    first.value[0] = 0.369105, first.value[1] = 0.546792;
    std::vector<truth::OwnedLog> owned;
    std::vector<const mk_log *> logs;
    for (const char *episode : episodes) {
        owned.emplace_back(measured_log("furuta-qube-servo1", episode, "furuta-qube-servo1"));
        if (!owned.back())
            return;
        logs.push_back(owned.back().get());
    }
    const auto r = fit(m, logs);
    const double before = error_of(m, logs), after = error_of(r->model, logs);
    ck_assert_msg(after < 1.5 * before, "%g, with the start's values %g", after, before);
}
END_TEST

Suite *suite_misfit(void)
{
    Suite *s = suite_create("misfit");
    TCase *t = tcase_create("data that a model does not follow");
    tcase_set_timeout(t, 120);
    tcase_add_test(t, a_model_that_misses_something_is_told_how_much);
    suite_add_tcase(s, t);
    TCase *more = tcase_create("more that a model does not follow");
    tcase_set_timeout(more, 120);
    tcase_set_tags(more, "long");
    tcase_add_test(more, data_of_another_rig_are_asked_about);
    tcase_add_test(more, a_fit_does_not_leave_measured_data_that_its_start_follows);
    suite_add_tcase(s, more);
    return s;
}

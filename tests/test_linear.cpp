/* Linear identification: recovery by every method, what is refused. */
#include "suites.h"

#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "mechkit/ident.h"
#include "mechkit/sim.h"

namespace
{

/* A log of the model under two sines, sampled at 1 kHz; every reading exact. */
mk_log *record(const mk_model &m, double amplitude, double seconds)
{
    mk_log *log;
    mk_sim *sim;
    size_t rows = (size_t)(seconds * 1000) + 1;
    int joints = mk_model_joints(&m);
    ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
    double *q[2] = {nullptr, nullptr}, *t, *u;
    mk_log_add_column(log, "t");
    mk_log_add_column(log, "u");
    for (int j = 0; j < joints; j++)
        mk_log_add_column(log, j ? "q2" : "q1");
    t = log->columns[0].data, u = log->columns[1].data;
    for (int j = 0; j < joints; j++)
        q[j] = log->columns[2 + j].data;
    double still[2] = {0, 0}, x[MK_MAX_STATES], y[2];
    ck_assert_int_eq(mk_sim_create(&m, nullptr, &sim, nullptr), MK_OK);
    mk_model_initial_state(&m, mk_plant(m.plant)->rest, still, x);
    ck_assert_int_eq(mk_sim_reset(sim, 0, x, nullptr), MK_OK);
    for (size_t k = 0; k < rows; k++) {
        t[k] = 0.001 * (double)k;
        double command[2] = {amplitude * (sin(6 * t[k]) + 0.6 * sin(2.3 * t[k])), 0};
        mk_sim_measure(sim, y);
        u[k] = command[0];
        for (int j = 0; j < joints; j++)
            q[j][k] = y[j];
        ck_assert_int_eq(mk_sim_advance(sim, 0.001 * (double)(k + 1), command, nullptr), MK_OK);
    }
    mk_sim_destroy(sim);
    return log;
}

enum mk_status fit(const mk_model &m, const mk_log *log, const char *method, mk_ident_result &r,
                   mk_error *err)
{
    mk_ident_options o = {};
    o.method = method;
    return mk_identify(&m, &log, 1, &o, &r, err);
}

START_TEST(every_method_finds_every_plants_parameters_on_exact_readings)
{
    const char *methods[] = {"sls", "wls", "swevers", "olsen", "energy"};
    for (int kind = 0; kind < 5; kind++) {
        mk_model truth;
        mk_model_default((enum mk_plant_kind)kind, &truth);
        mk_log *log = record(truth, 1.5, 20);
        for (const char *method : methods) {
            auto r = std::make_unique<mk_ident_result>();
            mk_error err = MK_ERROR_INIT;
            mk_model start = truth;
            for (double &p : start.parameter)
                p *= 1.2;
            ck_assert_msg(fit(start, log, method, *r, &err) == MK_OK, "%s %s: %s",
                          mk_plant(truth.plant)->name, method, err.message);
            for (int i = 0; i < r->parameter_count; i++) {
                double off = r->parameter[i].value / truth.parameter[i] - 1.0;
                ck_assert_msg(fabs(off) < 0.005,
                              "%s %s %s: off by %g %%", mk_plant(truth.plant)->name, method,
                              r->parameter[i].name, 100 * off);
            }
        }
        mk_log_free(log);
    }
}
END_TEST

START_TEST(a_held_parameter_stays_and_the_others_are_found)
{
    mk_model truth;
    mk_model_default(MK_PLANT_PENDUBOT, &truth);
    mk_log *log = record(truth, 1.5, 10);
    auto r = std::make_unique<mk_ident_result>();
    mk_ident_options o = {};
    o.method = "wls";
    o.fixed[4] = true;
    ck_assert_int_eq(mk_identify(&truth, &log, 1, &o, r.get(), nullptr), MK_OK);
    ck_assert_double_eq(r->parameter[4].value, truth.parameter[4]);
    ck_assert(r->parameter[4].fixed);
    ck_assert_double_eq_tol(r->parameter[0].value / truth.parameter[0], 1.0, 0.05);
    mk_log_free(log);
}
END_TEST

START_TEST(a_log_without_motion_is_refused)
{
    mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    mk_log *log = record(m, 0.0, 2);
    auto r = std::make_unique<mk_ident_result>();
    for (const char *method : {"sls", "wls", "swevers", "olsen", "energy"}) {
        mk_error err = MK_ERROR_INIT;
        ck_assert_int_eq(fit(m, log, method, *r, &err), MK_ERR_RANGE);
        ck_assert_ptr_nonnull(strstr(err.message, "moves"));
    }
    mk_log_free(log);
}
END_TEST

START_TEST(a_stuck_joint_is_refused)
{
    mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    mk_log *log = record(m, 1.5, 5);
    for (size_t k = 0; k < log->rows; k++)
        log->columns[3].data[k] = 0.0;
    auto r = std::make_unique<mk_ident_result>();
    mk_error err = MK_ERROR_INIT;
    ck_assert_int_ne(fit(m, log, "sls", *r, &err), MK_OK);
    ck_assert_uint_gt(strlen(err.message), 10);
    mk_log_free(log);
}
END_TEST

} // namespace

Suite *suite_linear(void)
{
    Suite *s = suite_create("linear");
    TCase *c = tcase_create("all");
    suite_add_tcase(s, c);
    tcase_add_test(c, every_method_finds_every_plants_parameters_on_exact_readings);
    tcase_add_test(c, a_held_parameter_stays_and_the_others_are_found);
    tcase_add_test(c, a_log_without_motion_is_refused);
    tcase_add_test(c, a_stuck_joint_is_refused);
    return s;
}

/* Simple experiments on motions made up here: the laws written out anew, readings in whole counts.
 */
#include <cmath>
#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "mechkit/json.h"
#include "mechkit/measure.h"
#include "mechkit/sim.h"
/* After the C++ library, which has a `fail` of its own. */
#include "suites.h"
extern "C" {
#include "support/files.h"
}

namespace
{

constexpr double RATE = 500.0, COUNT = 2.0 * M_PI / 4000.0;

struct LogFree {
    void operator()(mk_log *log) const { mk_log_free(log); }
};
using Log = std::unique_ptr<mk_log, LogFree>;

/* A log of angles and commands by time; angles are counted. */
Log made(double seconds, const std::function<double(double)> &angle,
         const std::function<double(double)> &command)
{
    mk_log *log;
    size_t rows = (size_t)(seconds * RATE);
    ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
    double *t = mk_log_add_column(log, "t"), *q = mk_log_add_column(log, "q1");
    double *u = mk_log_add_column(log, "u");
    for (size_t k = 0; k < rows; k++) {
        t[k] = (double)k / RATE;
        q[k] = COUNT * std::round(angle(t[k]) / COUNT);
        u[k] = command(t[k] + 0.5 / RATE);
    }
    return Log(log);
}

mk_measurement measured(const char *kind, const mk_model &m, const mk_log *log, double known = 0.0)
{
    auto out = std::make_unique<mk_measurement>();
    mk_error err = MK_ERROR_INIT;
    mk_measure_options o = {};
    o.known = known;
    enum mk_status st = mk_measure(kind, &m, &log, 1, &o, out.get(), &err);
    ck_assert_msg(st == MK_OK, "%s: %s", kind, err.message);
    return *out;
}

mk_quantity quantity(const mk_measurement &m, const char *name)
{
    for (int i = 0; i < m.quantity_count; i++)
        if (strcmp(m.quantity[i].name, name) == 0)
            return m.quantity[i];
    ck_abort_msg("there is no quantity '%s'", name);
    return {};
}

void within(const mk_quantity &q, double truth, double share)
{
    ck_assert_msg(std::fabs(q.value / truth - 1.0) < share, "%s: %.8g, not %.8g", q.name, q.value,
                  truth);
    ck_assert_msg(std::fabs(q.value - truth) < 5.0 * q.std_error,
                  "%s: %.8g +- %.2g, not within five errors of %.8g", q.name, q.value, q.std_error,
                  truth);
}

/* The report's wheel, (2.4): friction differs both ways. */
constexpr double J = 0.0045;
double friction(double v)
{
    return v > 0.0 ? 0.3399 + 0.0112 * v : -0.3575 + 0.0111 * v;
}

/* Speeds joined by straight lines. */
struct Profile {
    std::vector<double> t, v;

    size_t part(double at) const
    {
        size_t i = 0;
        while (i + 2 < t.size() && at >= t[i + 1])
            i++;
        return i;
    }
    double slope(size_t i) const { return (v[i + 1] - v[i]) / (t[i + 1] - t[i]); }
    double speed(double at) const
    {
        size_t i = part(at);
        return v[i] + slope(i) * (at - t[i]);
    }
    double angle(double at) const
    {
        size_t last = part(at);
        double q = 0.0;
        for (size_t i = 0; i < last; i++)
            q += 0.5 * (v[i] + v[i + 1]) * (t[i + 1] - t[i]);
        return q + 0.5 * (v[last] + speed(at)) * (at - t[last]);
    }
    Log log() const
    {
        return made(
            t.back(), [this](double at) { return angle(at); },
            [this](double at) {
                /* A little noise of the command, the same every time. */
                double noise = 2e-3 * std::sin(1234.5 * at * at);
                return J * slope(part(at)) + friction(speed(at)) + noise;
            });
    }
};

mk_model wheel()
{
    mk_model m;
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &m);
    return m;
}

mk_model pendulum()
{
    mk_model m;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    return m;
}

/* A pendulum let go at `start`, in steps of 20 us; friction with a sharp sign. */
Log let_go(const mk_model &m, double start, double coulomb, double seconds)
{
    constexpr double STEP = 2e-5;
    auto path = std::make_shared<std::vector<double>>();
    double q = start, v = 0.0;
    for (long i = 0; i < std::lround(seconds / STEP) + 1; i++) {
        if (i % 100 == 0)
            path->push_back(q);
        double pull = -m.parameter[1] * std::sin(q);
        double held = std::fmin(std::fabs(pull), coulomb);
        double f = v != 0.0 ? std::copysign(coulomb, v) : std::copysign(held, pull);
        double next = v + STEP * (pull - f) / m.parameter[0];
        v = v * next < 0.0 ? 0.0 : next;
        q += STEP * v;
    }
    return made(
        seconds, [path](double t) { return (*path)[(size_t)std::lround(t * RATE)]; },
        [](double) { return 0.0; });
}

} // namespace

START_TEST(friction_is_found_both_ways)
{
    Profile p = {{0, 1, 4, 5, 8, 9, 12, 14, 17, 18, 21, 22, 25},
                 {0, 15, 15, 40, 40, 90, 90, -20, -20, -50, -50, -100, -100}};
    Log log = p.log();
    mk_measurement m = measured("friction", wheel(), log.get());
    within(quantity(m, "coulomb forwards"), 0.3399, 0.01);
    within(quantity(m, "coulomb backwards"), 0.3575, 0.01);
    within(quantity(m, "viscous forwards"), 0.0112, 0.01);
    within(quantity(m, "viscous backwards"), 0.0111, 0.01);
    within(quantity(m, "p3, mean of both ways"), 0.3487, 0.01);
    /* The difference goes into the model as the effect that it is. */
    ck_assert_int_eq(m.model.effect_count, 1);
    ck_assert_str_eq(mk_effect(m.model.effect[0].index)->name, "coulomb-asymmetry");
    ck_assert_double_eq_tol(m.model.effect[0].value[0], -0.0176, 0.003);
}
END_TEST

START_TEST(inertia_is_found_though_the_model_s_friction_is_off)
{
    Profile p = {{0, 4, 6, 8, 10, 12, 13.5, 15}, {1, 81, 1, -79, -1, -101, -3, 80}};
    Log log = p.log();
    mk_measurement m = measured("inertia", wheel(), log.get(), 2.25e-5);
    within(quantity(m, "p1"), J, 0.005);
    within(quantity(m, "torque constant"), 2.25e-5 / J, 0.005);
    mk_model off = wheel();
    off.parameter[2] *= 1.3;
    within(quantity(measured("inertia", off, log.get()), "p1"), J, 0.005);
}
END_TEST

START_TEST(one_way_or_one_speed_is_too_little_for_friction)
{
    mk_model m = wheel();
    mk_measurement out;
    mk_error err = MK_ERROR_INIT;
    Log forwards = Profile{{0, 1, 4, 5, 8}, {0, 20, 20, 60, 60}}.log();
    const mk_log *log = forwards.get();
    ck_assert_int_eq(mk_measure("friction", &m, &log, 1, nullptr, &out, &err), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "backwards"));
    Log same = Profile{{0, 1, 4, 5, 8}, {0, 20, 20, -20, -20}}.log();
    log = same.get();
    ck_assert_int_eq(mk_measure("friction", &m, &log, 1, nullptr, &out, &err), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "one speed"));
}
END_TEST

/* Swings of 20 and 15 degrees lower the frequency by 0.77 and 0.43 %, the inertia read off is 1.5
 * and 0.9 % too large. */
START_TEST(finite_swings_are_corrected)
{
    mk_model m = pendulum();
    double omega = std::sqrt(m.parameter[1] / m.parameter[0]);
    for (double degrees : {20.0, 15.0}) {
        Log log = let_go(m, degrees * M_PI / 180.0, 0.0, 6.0);
        mk_measurement r = measured("swing", m, log.get());
        double raw = quantity(r, "first swings as read").value / omega - 1.0;
        ck_assert_double_eq_tol(raw, degrees == 20.0 ? -0.0077 : -0.0043, 3e-4);
        ck_assert_double_eq_tol(quantity(r, "corrected for amplitude").value / omega, 1.0, 2e-4);
        ck_assert_double_eq_tol(quantity(r, "fitted").value / omega, 1.0, 2e-4);
        ck_assert_double_eq_tol(quantity(r, "p1").value / m.parameter[0], 1.0, 5e-4);
    }
}
END_TEST

START_TEST(dry_friction_does_not_hide_the_frequency)
{
    mk_model m = pendulum();
    double omega = std::sqrt(m.parameter[1] / m.parameter[0]);
    Log log = let_go(m, 1.2, 0.35, 5.0);
    mk_measurement r = measured("swing", m, log.get());
    ck_assert_double_eq_tol(quantity(r, "corrected for amplitude").value / omega, 1.0, 5e-3);
    ck_assert_double_eq_tol(quantity(r, "fitted").value / omega, 1.0, 2e-3);
}
END_TEST

/* A release at 15 degrees shows 1.4032 Hz; small swings of pendulum and wheel together would have
 * sqrt(p3 g / (p1 + p2)). */
START_TEST(the_reaction_wheel_s_swing_carries_its_wheel)
{
    mk_model m;
    mk_model_default(MK_PLANT_REACTION_WHEEL, &m);
    mk_sim *sim;
    mk_log *log;
    ck_assert_int_eq(mk_sim_create(&m, nullptr, &sim, nullptr), MK_OK);
    double x[4] = {15.0 * M_PI / 180.0, 0, 0, 0}, off[2] = {0, 0}, y[2];
    ck_assert_int_eq(mk_sim_reset(sim, 0, x, nullptr), MK_OK);
    size_t rows = (size_t)(8 * RATE);
    ck_assert_int_eq(mk_log_create(rows, &log), MK_OK);
    Log owned(log);
    double *t = mk_log_add_column(log, "t"), *u = mk_log_add_column(log, "u");
    double *q[2] = {mk_log_add_column(log, "q1"), mk_log_add_column(log, "q2")};
    for (size_t k = 0; k < rows; k++) {
        t[k] = (double)k / RATE;
        u[k] = 0.0;
        mk_sim_measure(sim, y);
        for (int j = 0; j < 2; j++)
            q[j][k] = COUNT * std::round(y[j] / COUNT);
        ck_assert_int_eq(mk_sim_advance(sim, (double)(k + 1) / RATE, off, nullptr), MK_OK);
    }
    mk_sim_destroy(sim);
    mk_measurement r = measured("swing", m, log);
    double raw = quantity(r, "first swings as read").value / (2.0 * M_PI);
    ck_assert_double_eq_tol(raw, 1.4032, 3e-4);
    ck_assert_double_eq_tol(quantity(r, "p1 + p2").value / (m.parameter[0] + m.parameter[1]), 1.0,
                            5e-4);
    ck_assert_double_eq_tol(r.model.parameter[0] / m.parameter[0], 1.0, 5e-4);
    ck_assert_int_eq(r.warning_count, 1);
}
END_TEST

START_TEST(the_torque_constant_comes_from_a_slow_sweep)
{
    mk_model m = pendulum();
    const double moment = 6.8, coulomb = 0.31;
    auto angle = [](double t) { return std::sin(0.4 * t); };
    Log log = made(32.0, angle, [&](double t) {
        double v = 0.4 * std::cos(0.4 * t), a = -0.16 * std::sin(0.4 * t);
        double noise = 5e-3 * std::sin(777.7 * t * t);
        return moment * std::sin(angle(t)) + std::copysign(coulomb, v) + m.parameter[0] * a +
               m.parameter[2] * v + noise;
    });
    mk_measurement r = measured("torque", m, log.get(), 0.0345);
    within(quantity(r, "p2"), moment, 0.005);
    within(quantity(r, "torque constant"), 0.0345 / moment, 0.005);
}
END_TEST

START_TEST(what_does_not_fit_is_refused)
{
    mk_model m = pendulum();
    mk_measurement out;
    mk_error err = MK_ERROR_INIT;
    Log still = made(
        5.0, [](double) { return 0.0; }, [](double) { return 0.0; });
    const mk_log *log = still.get();
    ck_assert_int_eq(mk_measure("friction", &m, &log, 1, nullptr, &out, &err), MK_ERR_NOTSUP);
    ck_assert_int_eq(mk_measure("weight", &m, &log, 1, nullptr, &out, &err), MK_ERR_NOTFOUND);
    ck_assert_int_eq(mk_measure("swing", &m, &log, 1, nullptr, &out, &err), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "no free swing"));
    ck_assert_int_eq(mk_measure("torque", &m, &log, 1, nullptr, &out, &err), MK_ERR_RANGE);
}
END_TEST

/* The experiments that ship, on the virtual rig: what is measured is what the rig has. */
START_TEST(the_experiments_that_ship_give_the_rig_s_values)
{
    static const struct {
        const char *script, *kind, *rig, *quantity;
        double truth, share;
    } rows[] = {
        {"friction", "friction", "inertia-wheel", "p3, mean of both ways", 0.3487, 2e-3},
        {"inertia", "inertia", "inertia-wheel", "p1", 0.0045, 5e-3},
        {"swing-pendulum", "swing", "pendulum", "p1", 0.0624, 1e-3},
        {"swing-reaction-wheel", "swing", "reaction-wheel", "p1 + p2", 0.8589, 1e-3},
        {"torque", "torque", "pendulum", "p2", 7.0408, 2e-3},
    };
    char command[1500];
    std::string json = scratch("measured.json");
    std::string folder = json.substr(0, json.rfind('/'));
    snprintf(command, sizeof command,
             "%s run %s/scripts/measure-%s.cmd --fast --quiet --out %s && %s measure %s --model "
             "%s/models/%s.ini --json %s %s/measure-%s.csv >/dev/null",
             MK_TEST_APP, MK_SOURCE_DIR, rows[_i].script, folder.c_str(), MK_TEST_APP,
             rows[_i].kind, MK_SOURCE_DIR, rows[_i].rig, json.c_str(), folder.c_str(),
             rows[_i].script);
    ck_assert_int_eq(system(command), 0);
    cJSON *root;
    ck_assert_int_eq(mk_json_read(json.c_str(), &root, nullptr), MK_OK);
    cJSON *q = cJSON_GetObjectItem(cJSON_GetObjectItem(root, "quantities"), rows[_i].quantity);
    ck_assert_ptr_nonnull(q);
    double value = cJSON_GetObjectItem(q, "value")->valuedouble;
    ck_assert_double_eq_tol(value / rows[_i].truth, 1.0, rows[_i].share);
    cJSON_Delete(root);
}
END_TEST

Suite *suite_measure(void)
{
    Suite *s = suite_create("measure");
    TCase *c = tcase_create("all");
    tcase_set_timeout(c, 120);
    suite_add_tcase(s, c);
    tcase_add_test(c, friction_is_found_both_ways);
    tcase_add_test(c, inertia_is_found_though_the_model_s_friction_is_off);
    tcase_add_test(c, one_way_or_one_speed_is_too_little_for_friction);
    tcase_add_test(c, finite_swings_are_corrected);
    tcase_add_test(c, dry_friction_does_not_hide_the_frequency);
    tcase_add_test(c, the_reaction_wheel_s_swing_carries_its_wheel);
    tcase_add_test(c, the_torque_constant_comes_from_a_slow_sweep);
    tcase_add_test(c, what_does_not_fit_is_refused);
    tcase_add_loop_test(c, the_experiments_that_ship_give_the_rig_s_values, 0, 5);
    return s;
}

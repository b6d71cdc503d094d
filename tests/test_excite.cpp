/* Excitation: the search, the predicted errors, trajectories and inputs within limits. */
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "base/dense.hpp"
#include "ident/cma_es.hpp"
#include "ident/fit.hpp"
#include "ident/information.hpp"
#include "ident/waveforms.hpp"
#include "mechkit/excite.h"
#include "mechkit/signal.h"
#include "mechkit/sim.h"
/* After the C++ library, which has a `fail` of its own. */
#include "suites.h"
extern "C" {
#include "support/files.h"
}

namespace
{

using Eigen::VectorXd;

constexpr double COUNT = 2.0 * M_PI / 4000.0;

/* Readings of joint `j` from a start state under a held command, by the error-controlled solver. */
std::vector<double> readings(const mk_model &m, const double *x0, const std::vector<double> &u,
                             double period, int j)
{
    mk_sim *sim;
    std::vector<double> q;
    ck_assert_int_eq(mk_sim_create(&m, nullptr, &sim, nullptr), MK_OK);
    ck_assert_int_eq(mk_sim_reset(sim, 0, x0, nullptr), MK_OK);
    for (size_t k = 0; k < u.size(); k++) {
        double y[2], command[2] = {u[k], 0};
        mk_sim_measure(sim, y);
        q.push_back(y[j]);
        ck_assert_int_eq(mk_sim_advance(sim, (double)(k + 1) * period, command, nullptr), MK_OK);
    }
    mk_sim_destroy(sim);
    return q;
}

mk_excitation excited(const mk_model &m, const mk_excite_options &o)
{
    mk_excitation e = {};
    mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_excite(&m, &o, &e, &err) == MK_OK, "%s", err.message);
    return e;
}

} // namespace

START_TEST(the_search_finds_a_narrow_curved_valley_s_end)
{
    auto valley = [](const VectorXd &x) {
        double sum = 0.0;
        for (long i = 0; i + 1 < x.size(); i++)
            sum += 100.0 * pow(x(i + 1) - x(i) * x(i), 2) + pow(1.0 - x(i), 2);
        return sum;
    };
    mk::CmaOptions o;
    o.evaluations = 8000;
    o.tolerance = 1e-9;
    mk::CmaResult alone = mk::cma_es(valley, VectorXd::Zero(6), o);
    ck_assert_double_lt((alone.x - VectorXd::Ones(6)).norm(), 1e-5);
    o.threads = 3;
    mk::CmaResult together = mk::cma_es(valley, VectorXd::Zero(6), o);
    ck_assert((alone.x - together.x).norm() == 0.0);
}
END_TEST

START_TEST(a_series_starts_at_rest_where_it_should)
{
    VectorXd amplitudes(6);
    amplitudes << 0.3, -0.2, 0.5, 0.4, 0.1, -0.7;
    mk::Series s(3.7, amplitudes, -0.4);
    double q, v, a;
    s.at(0.0, q, v, a);
    ck_assert_double_eq_tol(q, -0.4, 1e-14);
    ck_assert_double_eq_tol(v, 0.0, 1e-14);
    ck_assert_double_eq_tol(a, 0.0, 1e-13);
    /* Speed and acceleration are those of the angle. */
    double before, after, vb, va, unused;
    s.at(0.8 - 1e-5, before, vb, unused);
    s.at(0.8 + 1e-5, after, va, unused);
    s.at(0.8, q, v, a);
    ck_assert_double_eq_tol(v, (after - before) / 2e-5, 1e-5);
    ck_assert_double_eq_tol(a, (va - vb) / 2e-5, 1e-4);
}
END_TEST

START_TEST(two_harmonics_start_by_the_corrected_conditions)
{
    VectorXd amplitudes(2);
    amplitudes << 0.3, -0.2;
    mk::Series s(5.0, amplitudes, 0.0);
    ck_assert_double_eq_tol(s.a[1], -s.a[0], 1e-15);
    ck_assert_double_eq_tol(s.b[1], -s.b[0] / 2.0, 1e-15);
    ck_assert_double_eq_tol(s.offset, 3.0 * s.b[0] / (4.0 * 5.0), 1e-15);
}
END_TEST

START_TEST(a_multisine_s_text_is_the_multisine)
{
    VectorXd c(4);
    c << 0.51237, -1.2, 0.3, 0.04;
    mk::Multisine wave(2.5, 1.9, c);
    mk_signal *signal;
    ck_assert_int_eq(mk_signal_create(wave.text().c_str(), &signal, nullptr), MK_OK);
    for (double t = 0.0; t < 10.0; t += 0.37)
        ck_assert_double_eq_tol(mk_signal_at(signal, t), wave.at(t), 1e-12);
    mk_signal_destroy(signal);
}
END_TEST

/* Against least squares on sensitivities by differences of the error-controlled solver. */
START_TEST(foreseen_errors_are_the_cramer_rao_bound)
{
    constexpr double PERIOD = 0.005;
    mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    std::vector<double> u;
    for (int k = 0; k < 600; k++)
        u.push_back(1.5 * sin(6.0 * PERIOD * k));
    std::vector<int> free = {0, 1, 2, 3, 4, 5, 6};
    mk::InformationOptions o;
    o.noise[0] = COUNT;
    o.noise[1] = 2.0 * COUNT;
    o.process_noise = 0.0;
    o.step = 1.25e-3;
    mk::PredictedExperiment f = mk::predict_experiment(m, u, PERIOD, free, o);
    ck_assert(f.finite());

    Eigen::MatrixXd jac(2 * (long)u.size(), 11);
    double rest[4] = {-M_PI / 2, 0, 0, 0};
    for (int c = 0; c < 11; c++)
        for (int j = 0; j < 2; j++) {
            std::vector<double> side[2];
            double scale = c < 7 ? m.parameter[c] : 1.0;
            for (int s = 0; s < 2; s++) {
                mk_model moved = m;
                double x[4], h = s ? 1e-5 : -1e-5;
                memcpy(x, rest, sizeof x);
                if (c < 7)
                    moved.parameter[c] += h * scale;
                else
                    x[c - 7] += h;
                side[s] = readings(moved, x, u, PERIOD, j);
            }
            for (size_t k = 0; k < u.size(); k++)
                jac(2 * (long)k + j, c) = (side[1][k] - side[0][k]) / 2e-5 / o.noise[j];
        }
    Eigen::MatrixXd cov = mk::dense::inverse(mk::dense::transpose_product(jac, jac));
    for (int i = 0; i < 7; i++)
        ck_assert_double_eq_tol(sqrt(f.covariance(i, i)) / sqrt(cov(i, i)), 1.0, 0.01);
}
END_TEST

START_TEST(a_rig_further_from_its_model_tells_less)
{
    mk_model m;
    mk_model_default(MK_PLANT_FURUTA, &m);
    std::vector<double> u;
    for (int k = 0; k < 1000; k++)
        u.push_back(1.5 * sin(0.03 * k));
    mk::InformationOptions o;
    o.noise[0] = o.noise[1] = COUNT;
    VectorXd last = VectorXd::Zero(6);
    for (double process_noise : {0.0, 1e-4, 1e-3, 1e-2}) {
        o.process_noise = process_noise;
        VectorXd now =
            mk::predict_experiment(m, u, 0.005, {0, 1, 2, 3, 4, 5}, o).covariance.diagonal();
        ck_assert((now.array() > last.array()).all());
        last = now;
    }
}
END_TEST

/* Report 3.2: 4.4452 with two harmonics. Scaled columns as in 3.1.2, and unscaled. */
START_TEST(the_pendulum_s_condition_number_is_below_the_report_s)
{
    mk_model m;
    mk_model_default(MK_PLANT_PENDULUM, &m);
    for (bool scaled : {true, false}) {
        double last = 4.4452;
        for (int harmonics : {2, 3, 5}) {
            mk_excite_options o;
            mk_excite_default(&m, &o);
            o.criterion = scaled ? MK_EXCITE_CONDITION : MK_EXCITE_CONDITION_UNSCALED;
            o.harmonics = harmonics;
            o.evaluations = 1000 * harmonics;
            mk_excitation e = excited(m, o);
            double k = scaled ? e.regressor_condition_scaled : e.regressor_condition;
            ck_assert_msg(k < last, "%d harmonics: %g, not below %g", harmonics, k, last);
            ck_assert_double_le(e.figures.u_max, o.u_max);
            last = k;
            mk_excitation_clear(&e);
        }
    }
}
END_TEST

START_TEST(the_rig_follows_the_planned_trajectory)
{
    for (enum mk_plant_kind kind : {MK_PLANT_PENDULUM, MK_PLANT_INERTIA_WHEEL}) {
        mk_model m;
        mk_model_default(kind, &m);
        mk_excite_options o;
        mk_excite_default(&m, &o);
        o.evaluations = 1500;
        mk_excitation e = excited(m, o);
        const double *u = mk_log_get(e.plan, "u"), *q = mk_log_get(e.plan, "q1");
        double still[2] = {0, 0}, reach = 0.0;
        std::vector<double> command(u, u + e.plan->rows);
        std::vector<double> y = readings(m, still, command, 1.0 / e.rate_hz, 0);
        for (size_t k = 0; k < y.size(); k++)
            reach = fmax(reach, fabs(q[k]));
        for (size_t k = 0; k < y.size(); k++)
            ck_assert_double_eq_tol(y[k], q[k], 0.02 * reach);
        mk_excitation_clear(&e);
    }
}
END_TEST

START_TEST(a_rig_with_a_free_joint_is_not_led_along_a_trajectory)
{
    mk_model m;
    mk_excite_options o;
    mk_excitation e = {};
    mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    mk_excite_default(&m, &o);
    o.criterion = MK_EXCITE_CONDITION;
    ck_assert_int_eq(mk_excite(&m, &o, &e, &err), MK_ERR_NOTSUP);
    ck_assert_ptr_nonnull(strstr(err.message, "without motor"));
}
END_TEST

/* A short search; the thorough one is for experiments. */
START_TEST(a_searched_input_tells_more_than_a_sine_within_the_limits)
{
    static const enum mk_plant_kind kinds[] = {MK_PLANT_PENDUBOT, MK_PLANT_REACTION_WHEEL,
                                               MK_PLANT_FURUTA};
    mk_model m;
    mk_excite_options o;
    mk_model_default(kinds[_i], &m);
    mk_excite_default(&m, &o);
    o.seconds = 5.0;
    o.u_max = 1.5;
    o.harmonics = 5;
    o.evaluations = 500;
    mk_excitation e = excited(m, o);
    ck_assert_double_lt(2.0 * e.figures.worst, e.against_figures.worst);
    ck_assert_double_le(e.figures.u_max, 1.5);
    const mk_plant_info *plant = mk_plant(m.plant);
    for (int j = 0; j < plant->joints; j++) {
        ck_assert_double_le(e.figures.v_max[j], 1.01 * o.v_max[j]);
        if (!plant->joint_is_wheel[j]) {
            ck_assert_double_ge(e.figures.q_min[j], o.q_min[j] - 0.05);
            ck_assert_double_le(e.figures.q_max[j], o.q_max[j] + 0.05);
        }
    }
    mk_excitation_clear(&e);
}
END_TEST

START_TEST(the_answer_does_not_depend_on_the_threads)
{
    mk_model m;
    mk_excite_options o;
    mk_model_default(MK_PLANT_FURUTA, &m);
    mk_excite_default(&m, &o);
    o.seconds = 2.0;
    o.harmonics = 3;
    o.evaluations = 200;
    o.threads = 1;
    mk_excitation alone = excited(m, o);
    o.threads = 3;
    mk_excitation together = excited(m, o);
    ck_assert_str_eq(alone.input, together.input);
    mk_excitation_clear(&alone);
    mk_excitation_clear(&together);
}
END_TEST

START_TEST(an_uncertain_model_promises_less)
{
    mk_model m;
    mk_excite_options o;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    mk_excite_default(&m, &o);
    o.seconds = 3.0;
    o.harmonics = 3;
    o.evaluations = 100;
    mk_excitation sure = excited(m, o);
    ck_assert(std::isnan(sure.worst_of_rigs));
    o.spread = 0.1;
    mk_excitation unsure = excited(m, o);
    ck_assert_double_gt(unsure.worst_of_rigs, 1.02 * unsure.figures.worst);
    ck_assert_str_ne(sure.input, unsure.input);
    mk_excitation_clear(&sure);
    mk_excitation_clear(&unsure);
}
END_TEST

/* The whole search takes a minute; what it found ships with the program. */
START_TEST(the_inputs_that_ship_tell_three_times_as_much_as_the_report_s_sine)
{
    static const char *const rigs[] = {"pendubot", "reaction-wheel", "furuta"};
    std::string path = std::string(MK_SOURCE_DIR "/scripts/excite-") + rigs[_i] + ".cmd";
    std::unique_ptr<char, void (*)(void *)> text(slurp_file(path.c_str()), free);
    ck_assert_ptr_nonnull(text.get());
    std::string input = strstr(text.get(), "\ninput ") + 7;
    mk_signal *signal;
    ck_assert_int_eq(mk_signal_create(input.substr(0, input.find('\n')).c_str(), &signal, nullptr),
                     MK_OK);
    mk_model m;
    mk_excite_options limits;
    mk_model_default(mk_plant_by_name(rigs[_i])->kind, &m);
    mk_excite_default(&m, &limits);
    mk::InformationOptions o;
    o.noise[0] = o.noise[1] = limits.noise[0];
    o.process_noise = limits.process_noise;
    o.step = 2.5e-3;
    double worst[2];
    for (bool sine : {false, true}) {
        std::vector<double> u;
        for (int k = 0; k < 5000; k++) {
            u.push_back(sine ? 1.5 * sin(6.0 * k / 500.0) : mk_signal_at(signal, k / 500.0));
            ck_assert_double_le(fabs(u.back()), 1.5);
        }
        mk::PredictedExperiment f =
            mk::predict_experiment(m, u, 0.002, mk::fitted_parameters(m), o);
        ck_assert(f.finite());
        worst[sine] = sqrt(f.covariance.diagonal().maxCoeff());
        for (int j = 0; j < 2; j++)
            ck_assert_double_le(f.v_max[j], limits.v_max[j]);
    }
    ck_assert_double_gt(worst[1], 3.0 * worst[0]);
    mk_signal_destroy(signal);
}
END_TEST

START_TEST(what_is_out_of_range_is_refused_by_name)
{
    mk_model m;
    mk_excitation e = {};
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    struct {
        const char *word;
        void (*spoil)(mk_excite_options *);
    } rows[] = {{"harmonics", [](mk_excite_options *o) { o->harmonics = 1; }},
                {"limit", [](mk_excite_options *o) { o->u_max = 11.0; }},
                {"joint 1", [](mk_excite_options *o) { o->q_min[0] = 0.0; }},
                {"spread", [](mk_excite_options *o) { o->spread = 0.9; }},
                {" s:", [](mk_excite_options *o) { o->seconds = 0.0; }},
                {"held", [](mk_excite_options *o) { memset(o->fixed, 1, sizeof o->fixed); }}};
    for (auto &row : rows) {
        mk_excite_options o;
        mk_error err = MK_ERROR_INIT;
        mk_excite_default(&m, &o);
        row.spoil(&o);
        ck_assert_int_eq(mk_excite(&m, &o, &e, &err), MK_ERR_RANGE);
        ck_assert_msg(strstr(err.message, row.word) != NULL, "%s", err.message);
    }
}
END_TEST

START_TEST(an_input_that_leaves_the_limits_is_not_offered)
{
    mk_model m;
    mk_excite_options o;
    mk_excitation e = {};
    mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    mk_excite_default(&m, &o);
    o.seconds = 2.0;
    o.evaluations = 100;
    o.v_max[0] = o.v_max[1] = 1e-4;
    ck_assert_int_eq(mk_excite(&m, &o, &e, &err), MK_ERR_NUMERIC);
    ck_assert_ptr_nonnull(strstr(err.message, "keeps to the limits"));
    ck_assert_ptr_null(e.plan);
}
END_TEST

START_TEST(a_wrong_signal_to_compare_with_is_found_before_the_search)
{
    mk_model m;
    mk_excite_options o;
    mk_excitation e = {};
    mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    mk_excite_default(&m, &o);
    o.against = "2*sinus(t)";
    o.progress = [](void *, double, const char *) {
        ck_abort_msg("it searches");
        return false;
    };
    ck_assert_int_eq(mk_excite(&m, &o, &e, &err), MK_ERR_PARSE);
}
END_TEST

START_TEST(the_command_files_run_and_log_what_was_planned)
{
    for (const char *rig : {"pendulum", "pendubot"}) {
        char command[1200];
        std::string out = scratch((std::string(rig) + "-go.cmd").c_str()), app = MK_TEST_APP;
        std::string folder = out.substr(0, out.rfind('/'));
        snprintf(command, sizeof command,
                 "%s excite --model %s/models/%s.ini --out %s --seconds 3 --u-max 3 --tries 200 "
                 ">/dev/null && %s run %s --fast --quiet --out %s",
                 app.c_str(), MK_SOURCE_DIR, rig, out.c_str(), app.c_str(), out.c_str(),
                 folder.c_str());
        ck_assert_int_eq(system(command), 0);
        mk_log *log;
        std::string path = folder + "/" + rig + "-go-log.csv";
        mk_error err = MK_ERROR_INIT;
        ck_assert_msg(mk_log_read(path.c_str(), &log, &err) == MK_OK, "%s", err.message);
        const double *u = mk_log_get(log, "u");
        double most = 0.0;
        for (size_t k = 0; k < log->rows; k++)
            most = fmax(most, fabs(u[k]));
        ck_assert_double_le(most, 3.0);
        ck_assert_double_ge(most, 1.0);
        mk_log_free(log);
    }
}
END_TEST

Suite *suite_excite(void)
{
    Suite *s = suite_create("excite");
    TCase *c = tcase_create("all");
    tcase_set_timeout(c, 120);
    suite_add_tcase(s, c);
    tcase_add_test(c, the_search_finds_a_narrow_curved_valley_s_end);
    tcase_add_test(c, a_series_starts_at_rest_where_it_should);
    tcase_add_test(c, two_harmonics_start_by_the_corrected_conditions);
    tcase_add_test(c, a_multisine_s_text_is_the_multisine);
    tcase_add_test(c, foreseen_errors_are_the_cramer_rao_bound);
    tcase_add_test(c, a_rig_further_from_its_model_tells_less);
    tcase_add_test(c, the_rig_follows_the_planned_trajectory);
    tcase_add_test(c, a_rig_with_a_free_joint_is_not_led_along_a_trajectory);
    tcase_add_loop_test(c, a_searched_input_tells_more_than_a_sine_within_the_limits, 1, 2);
    tcase_add_loop_test(c, the_inputs_that_ship_tell_three_times_as_much_as_the_report_s_sine, 0,
                        3);
    tcase_add_test(c, the_answer_does_not_depend_on_the_threads);
    tcase_add_test(c, what_is_out_of_range_is_refused_by_name);
    tcase_add_test(c, an_input_that_leaves_the_limits_is_not_offered);
    tcase_add_test(c, a_wrong_signal_to_compare_with_is_found_before_the_search);
    tcase_add_test(c, the_command_files_run_and_log_what_was_planned);
    c = tcase_create("more searches");
    tcase_set_timeout(c, 120);
    tcase_set_tags(c, "long");
    suite_add_tcase(s, c);
    tcase_add_loop_test(c, a_searched_input_tells_more_than_a_sine_within_the_limits, 0, 1);
    tcase_add_loop_test(c, a_searched_input_tells_more_than_a_sine_within_the_limits, 2, 3);
    tcase_add_test(c, the_pendulum_s_condition_number_is_below_the_report_s);
    tcase_add_test(c, an_uncertain_model_promises_less);
    return s;
}

// The fast path: elementary functions against long double, trajectories against CVODE, kernels
// against each other.
#include "suites.h"

#include <cfloat>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "mechkit/sim.h"
#include "sim/fast.hpp"

namespace
{

double ulps(double got, long double want)
{
    double near = static_cast<double>(want);
    double unit = std::nextafter(std::fabs(near), HUGE_VAL) - std::fabs(near);
    return static_cast<double>(fabsl(got - want)) / std::fmax(unit, DBL_TRUE_MIN);
}

double uniform()
{
    return 2.0 * rand() / RAND_MAX - 1.0;
}

struct Run {
    std::vector<mk_model> models;
    std::vector<double> x0, u, x;
    mk_batch batch = {};

    Run(enum mk_plant_kind kind, int count, int samples, double dt)
    {
        mk_model m;
        mk_model_default(kind, &m);
        int ns = mk_model_state_count(&m), n = mk_model_joints(&m);
        srand(17);
        for (int i = 0; i < count; i++) {
            mk_model one = m;
            for (int k = 0; k < mk_plant(kind)->parameter_count; k++)
                one.parameter[k] *= 1.0 + 0.05 * uniform() * (i > 0);
            models.push_back(one);
            for (int k = 0; k < ns; k++)
                x0.push_back(k < n ? mk_plant(kind)->rest[k] + 0.1 * uniform() : 0.2 * uniform());
            for (int k = 0; k < samples; k++) {
                u.push_back(3.0 * std::sin(5.0 * k * dt + i));
                u.push_back(0.0);
            }
        }
        x.resize(static_cast<size_t>(count * (samples + 1) * ns));
        batch.model = models.data();
        batch.model_count = count;
        batch.samples = samples;
        batch.dt = dt;
        batch.x0 = x0.data();
        batch.u = u.data();
        batch.x = x.data();
        batch.rtol = 1e-11;
        batch.atol = 1e-11;
    }
    void go()
    {
        mk_error err = MK_ERROR_INIT;
        ck_assert_msg(mk_simulate_batch(&batch, &err) == MK_OK, "%s", err.message);
    }
};

double distance(const std::vector<double> &a, const double *b, size_t n)
{
    double worst = 0.0;
    for (size_t i = 0; i < n; i++)
        worst = std::fmax(worst, std::fabs(a[i] - b[i]) / (1.0 + std::fabs(b[i])));
    return worst;
}

} // namespace

START_TEST(lanes_compute_elementary_functions_to_the_last_places)
{
    const mk::FastKernel *k = mk::fast_kernel(_i);
    if (!k)
        return; // this machine has fewer instruction sets
    std::vector<double> x(4096), y(4096);
    double worst[4] = {};
    for (int f = 0; f < 4; f++)
        for (int round = 0; round < 40; round++) {
            for (double &v : x)
                v = uniform() * (f == 3 ? 700.0 : std::pow(10.0, rand() % 9 - 5));
            k->function(f, 4096, x.data(), y.data());
            for (size_t i = 0; i < x.size(); i++) {
                long double want = f == 0   ? sinl(x[i])
                                   : f == 1 ? cosl(x[i])
                                   : f == 2 ? tanhl(x[i])
                                            : expl(x[i]);
                worst[f] = std::fmax(worst[f], ulps(y[i], want));
            }
        }
    ck_assert_double_lt(worst[0], 2.0);
    ck_assert_double_lt(worst[1], 2.0);
    ck_assert_double_lt(worst[2], 5.0);
    ck_assert_double_lt(worst[3], 2.5);
    // Huge angles, saturation, nothing.
    double at[8] = {1e7, -1e300, 400.0, -400.0, 0.0, -0.0, 800.0, -800.0}, out[8];
    k->function(0, 2, at, out);
    ck_assert_double_eq(out[0], std::sin(1e7));
    ck_assert_double_eq(out[1], std::sin(-1e300));
    k->function(2, 8, at, out);
    ck_assert_double_eq(out[2], 1.0);
    ck_assert_double_eq(out[3], -1.0);
    ck_assert_double_eq(out[4], 0.0);
    k->function(3, 8, at, out);
    ck_assert_double_eq(out[7], 0.0);
    double nan[2] = {NAN, INFINITY};
    k->function(0, 2, nan, out);
    ck_assert(std::isnan(out[0]) && std::isnan(out[1]));
}
END_TEST

START_TEST(held_commands_agree_with_cvode)
{
    auto kind = static_cast<enum mk_plant_kind>(_i);
    Run run(kind, 11, 200, 0.005);
    run.go();
    size_t ns = static_cast<size_t>(mk_model_state_count(&run.models[0]));
    for (size_t i = 0; i < 11; i += 5) {
        mk_sim *sim;
        mk_sim_config c = {MK_SOLVER_CVODE_ADAMS, 1e-12, 1e-13};
        ck_assert_int_eq(mk_sim_create(&run.models[i], &c, &sim, nullptr), MK_OK);
        ck_assert_int_eq(mk_sim_reset(sim, 0.0, &run.x0[i * ns], nullptr), MK_OK);
        for (size_t k = 0; k < 200; k++) {
            ck_assert_int_eq(mk_sim_advance(sim, static_cast<double>(k + 1) * 0.005,
                                            &run.u[(i * 200 + k) * 2], nullptr),
                             MK_OK);
            std::vector<double> state(mk_sim_state(sim), mk_sim_state(sim) + ns);
            ck_assert_double_lt(distance(state, &run.x[(i * 201 + k + 1) * ns], ns), 1e-8);
        }
        mk_sim_destroy(sim);
    }
}
END_TEST

START_TEST(a_batch_gives_what_single_runs_give)
{
    auto kind = static_cast<enum mk_plant_kind>(_i);
    Run many(kind, 11, 100, 0.005);
    many.go();
    size_t ns = static_cast<size_t>(mk_model_state_count(&many.models[0]));
    for (size_t i = 0; i < 11; i++) {
        Run one(kind, 1, 100, 0.005);
        one.models[0] = many.models[i];
        one.x0.assign(&many.x0[i * ns], &many.x0[i * ns] + ns);
        one.u.assign(&many.u[i * 200], &many.u[i * 200] + 200);
        one.batch.x0 = one.x0.data();
        one.batch.u = one.u.data();
        one.go();
        ck_assert_double_lt(distance(one.x, &many.x[i * 101 * ns], 101 * ns), 1e-9);
    }
}
END_TEST

START_TEST(every_instruction_set_gives_the_same_trajectories)
{
    Run reference(MK_PLANT_PENDUBOT, 5, 400, 0.005);
    mk_error err = MK_ERROR_INIT;
    ck_assert_int_eq(mk::fast_kernel(0)->run(&reference.batch, &err), MK_OK);
    for (int k = 1; mk::fast_kernel(k); k++) {
        Run other(MK_PLANT_PENDUBOT, 5, 400, 0.005);
        ck_assert_int_eq(mk::fast_kernel(k)->run(&other.batch, &err), MK_OK);
        ck_assert_double_lt(distance(other.x, reference.x.data(), reference.x.size()), 1e-8);
    }
}
END_TEST

START_TEST(dense_output_is_as_good_as_the_steps)
{
    // A smooth drive is stepped freely; outputs in between come from the interpolant.
    mk_sine drive = {1.5, 6.0, 0.3};
    Run coarse(MK_PLANT_PENDUBOT, 1, 400, 0.005), fine(MK_PLANT_PENDUBOT, 1, 400, 0.005);
    coarse.batch.drive = fine.batch.drive = &drive;
    coarse.batch.rtol = coarse.batch.atol = 1e-10;
    fine.batch.rtol = fine.batch.atol = 1e-13;
    coarse.go();
    fine.go();
    ck_assert_double_lt(distance(coarse.x, fine.x.data(), fine.x.size()), 1e-7);
    ck_assert_uint_lt(coarse.batch.steps, 400);
}
END_TEST

START_TEST(a_trajectory_alone_is_what_another_method_gives_in_a_batch)
{
    // Collocation where registers are wide, DOP853 in the batch.
    auto kind = static_cast<enum mk_plant_kind>(_i);
    for (double sharpness : {15.0, 400.0}) {
        mk_sine drive = {1.5, 6.0, 0.3};
        Run many(kind, 2, 400, 0.005), one(kind, 1, 400, 0.005);
        const size_t ns = one.x0.size();
        many.models[1] = many.models[0];
        for (size_t k = 0; k < ns; k++)
            many.x0[ns + k] = many.x0[k];
        one.models[0].friction_sharpness = sharpness;
        for (mk_model &m : many.models)
            m.friction_sharpness = sharpness;
        one.batch.drive = many.batch.drive = &drive;
        one.go();
        many.go();
        ck_assert_double_lt(distance(one.x, many.x.data(), one.x.size()), 1e-8);
    }
}
END_TEST

START_TEST(every_instruction_set_follows_a_smooth_drive)
{
    mk_sine drive = {2.0, 9.0, 0.0};
    mk_error err = MK_ERROR_INIT;
    Run reference(MK_PLANT_CART_POLE, 1, 400, 0.005);
    reference.batch.drive = &drive;
    ck_assert_int_eq(mk::fast_kernel(0)->run(&reference.batch, &err), MK_OK);
    for (int k = 1; mk::fast_kernel(k); k++) {
        Run other(MK_PLANT_CART_POLE, 1, 400, 0.005);
        other.batch.drive = &drive;
        ck_assert_int_eq(mk::fast_kernel(k)->run(&other.batch, &err), MK_OK);
        ck_assert_double_lt(distance(other.x, reference.x.data(), reference.x.size()), 1e-8);
    }
}
END_TEST

START_TEST(a_trajectory_alone_keeps_its_energy)
{
    mk_sine none = {0.0, 0.0, 0.0};
    Run run(MK_PLANT_PENDUBOT, 1, 400, 0.02);
    run.models[0].parameter[5] = run.models[0].parameter[6] = 0.0;
    run.batch.drive = &none;
    run.x0[0] = 0.5, run.x0[1] = 1.0;
    run.batch.rtol = run.batch.atol = 1e-12;
    run.go();
    const double start = mk_plant_kinetic(&run.models[0], &run.x[0], &run.x[2]) +
                         mk_plant_potential(&run.models[0], &run.x[0]);
    for (size_t k = 1; k <= 400; k++) {
        const double *x = &run.x[4 * k];
        ck_assert_double_eq_tol(mk_plant_kinetic(&run.models[0], x, x + 2) +
                                    mk_plant_potential(&run.models[0], x),
                                start, 1e-8);
    }
}
END_TEST

START_TEST(the_error_falls_with_the_tolerance)
{
    mk_sine drive = {1.5, 6.0, 0.0};
    Run best(MK_PLANT_FURUTA, 1, 200, 0.005);
    best.batch.drive = &drive;
    best.batch.rtol = best.batch.atol = 1e-14;
    best.go();
    double before = HUGE_VAL;
    for (double tol = 1e-7; tol > 1e-12; tol *= 1e-2) {
        Run run(MK_PLANT_FURUTA, 1, 200, 0.005);
        run.batch.drive = &drive;
        run.batch.rtol = run.batch.atol = tol;
        run.go();
        double error = distance(run.x, best.x.data(), best.x.size());
        ck_assert_double_lt(error, 0.3 * before);
        before = error;
    }
    ck_assert_double_lt(before, 1e-9);
}
END_TEST

START_TEST(energy_is_conserved_in_lanes)
{
    Run run(MK_PLANT_PENDUBOT, 8, 200, 0.02);
    for (mk_model &m : run.models)
        m.parameter[5] = m.parameter[6] = 0.0;
    for (double &u : run.u)
        u = 0.0;
    for (size_t i = 0; i < run.x0.size(); i += 4)
        run.x0[i] = 0.5, run.x0[i + 1] = 1.0;
    run.batch.rtol = run.batch.atol = 1e-12;
    run.go();
    for (size_t i = 0; i < 8; i++) {
        double energy[2];
        for (size_t end = 0; end < 2; end++) {
            const double *x = &run.x[(i * 201 + end * 200) * 4];
            energy[end] =
                mk_plant_kinetic(&run.models[i], x, x + 2) + mk_plant_potential(&run.models[i], x);
        }
        ck_assert_double_eq_tol(energy[0], energy[1], 1e-8);
    }
}
END_TEST

START_TEST(what_it_cannot_do_is_refused_and_ends)
{
    mk_error err = MK_ERROR_INIT;
    Run run(MK_PLANT_PENDUBOT, 3, 10, 0.005);
    ck_assert_int_eq(mk_model_add_effect(&run.models[1], "backlash", 2, &err), MK_OK);
    ck_assert_int_eq(mk_simulate_batch(&run.batch, &err), MK_ERR_NOTSUP);
    Run mixed(MK_PLANT_PENDUBOT, 3, 10, 0.005);
    mk_model_default(MK_PLANT_FURUTA, &mixed.models[2]);
    ck_assert_int_eq(mk_simulate_batch(&mixed.batch, &err), MK_ERR_INVALID);
    Run lost(MK_PLANT_PENDUBOT, 3, 10, 0.005);
    lost.x0[5] = NAN;
    ck_assert_int_eq(mk_simulate_batch(&lost.batch, &err), MK_ERR_NUMERIC);
    Run wild(MK_PLANT_PENDUBOT, 1, 10, 0.005);
    wild.x0[2] = 1e200;
    ck_assert_int_eq(mk_simulate_batch(&wild.batch, &err), MK_ERR_NUMERIC);
    mk_sine drive = {1.0, 1.0, 0.0};
    wild.batch.drive = &drive;
    ck_assert_int_eq(mk_simulate_batch(&wild.batch, &err), MK_ERR_NUMERIC);
    drive.amplitude = NAN;
    wild.x0[2] = 0.0;
    ck_assert_int_eq(mk_simulate_batch(&wild.batch, &err), MK_ERR_NUMERIC);
}
END_TEST

extern "C" Suite *suite_fast(void)
{
    Suite *s = suite_create("fast");
    TCase *t = tcase_create("kernels");
    tcase_set_timeout(t, 30);
    tcase_add_loop_test(t, lanes_compute_elementary_functions_to_the_last_places, 0, 3);
    tcase_add_loop_test(t, held_commands_agree_with_cvode, 0, MK_PLANT_COUNT);
    tcase_add_loop_test(t, a_batch_gives_what_single_runs_give, 0, MK_PLANT_COUNT);
    tcase_add_test(t, every_instruction_set_gives_the_same_trajectories);
    tcase_add_test(t, dense_output_is_as_good_as_the_steps);
    tcase_add_loop_test(t, a_trajectory_alone_is_what_another_method_gives_in_a_batch, 0,
                        MK_PLANT_COUNT);
    tcase_add_test(t, every_instruction_set_follows_a_smooth_drive);
    tcase_add_test(t, a_trajectory_alone_keeps_its_energy);
    tcase_add_test(t, the_error_falls_with_the_tolerance);
    tcase_add_test(t, energy_is_conserved_in_lanes);
    tcase_add_test(t, what_it_cannot_do_is_refused_and_ends);
    suite_add_tcase(s, t);
    return s;
}

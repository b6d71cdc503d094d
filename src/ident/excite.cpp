// Excitation: the input that tells most about a rig's parameters, within limits
// (mechkit/excite.h, docs/identification.md).
//
// The unknowns of the search are one vector x: x_0 = log(f / Hz), the logarithm of the base
// frequency, and behind it amplitudes. Limits are no constraints of the search but a penalty,
//     J(x) = log(criterion(x)) + OVER sum_i excess_i(x) ,
// so that an excess of 10 % costs as much as a criterion that is e times as large. excess_i is 0
// within a limit, and beyond it a share: of the limit for speeds and commands, of the range for
// angles (ident/excite_cost.hpp).
//
// Two kinds of criterion.
//     condition      The only joint is controlled along a Fourier series q(t), (3.9)-(3.11) of
//                    Meesters. With Phi the regressor of tau = Phi p, a row for each instant of one
//                    period, the criterion is cond(Phi), its largest singular value over its least,
//                    with columns of unit norm or as they are. No trajectory is integrated: motion
//                    and command are known in closed form.
//     worst, a, d    The command itself is a multisine u(t). With C (n x n) the covariance of the
//                    relative errors of the n free parameters that the Cramer-Rao bound leaves
//                    (ident/information.hpp), the criterion is
//                        worst = max_i sqrt(C_ii) ,   a = sqrt(tr C / n) ,   d = det(C)^(1/2n) .
//                    The last two order inputs as A- and D-optimality do.
//
// J has kinks (limits), cliffs (a pendulum that just goes over) and several valleys, so that it is
// minimised without derivatives, by CMA-ES (ident/cma_es.hpp). The search looks at coarse samples;
// all figures of the result are made again at the rate of the loop.
#include "mechkit/excite.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <new>

#include "base/parallel.hpp"
#include "base/random.h"
#include "ident/cma_es.hpp"
#include "ident/excite_cost.hpp"
#include "ident/fit.hpp"
#include "ident/information.hpp"
#include "ident/waveforms.hpp"
#include "mechkit/number.h"
#include "mechkit/safety.h"
#include "mechkit/signal.h"

namespace mk
{

namespace
{

using Eigen::VectorXd;

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();
constexpr double TWO_PI = 6.283185307179586;
// Samples per second of the search, and points of a trajectory's period. The figures of the result
// come from the rate of the loop.
constexpr double SEARCH_RATE_HZ = 200.0;
constexpr int SEARCH_POINTS = 240; // of a trajectory's period
constexpr double OVER = 10.0;      // weight of a limit's relative excess, against the log of a cost
constexpr double TOLERATED = 0.01; // excess of the plan, which is reckoned more finely
constexpr int STARTS = 3;
constexpr double HIGHEST_BASE_HZ = 1.5; // of a multisine

bool by_condition(enum mk_excite_criterion c)
{
    return c == MK_EXCITE_CONDITION || c == MK_EXCITE_CONDITION_UNSCALED;
}

bool fully_actuated(const mk_model &model)
{
    return mk_plant(model.plant)->joints == 1;
}

// Unknowns: log of the frequency in Hz, then the series' amplitudes.
Series series_of(const mk_model &model, const VectorXd &x)
{
    return Series(TWO_PI * std::exp(x(0)), x.tail(x.size() - 1), mk_plant(model.plant)->rest[0]);
}

// u_k = u(k / rate) for k = 0 .. round(seconds rate) - 1, held from row to row when it is run.
std::vector<double> sampled(const Multisine &wave, double seconds, double rate)
{
    std::vector<double> u((size_t)std::lround(seconds * rate));
    for (size_t k = 0; k < u.size(); k++)
        u[k] = wave.at((double)k / rate);
    return u;
}

class Excitation
{
  public:
    Excitation(const mk_model &m, const mk_excite_options &opt, mk_excitation &result)
        : model(m), o(opt), out(result), led(by_condition(opt.criterion))
    {
        // The parameters that a later fit moves; those that are held take no part in C.
        for (int number : fitted_parameters(m))
            if (!o.fixed[number])
                free.push_back(number);
        threads = threads_for(o.threads);
    }

    // Fills the plan and the figures of `out`. MK_ERR_RANGE: no free parameter; MK_ERR_NUMERIC: the
    // model runs away under every input, or even the best one leaves the limits by more than
    // TOLERATED; MK_ERR_INTR, MK_ERR_NOMEM. On failure out.plan may be there; the caller frees it.
    enum mk_status run(mk_error *err)
    {
        if (free.empty())
            return mk_error_set(err, MK_ERR_RANGE, "every parameter is held: nothing to excite");
        draw_rigs();
        VectorXd best;
        enum mk_status st = search(best, err);
        if (st != MK_OK)
            return st;
        std::vector<double> u;
        st = led ? plan_trajectory(best, u, err) : plan_input(best, u, err);
        if (st != MK_OK)
            return st;
        fill(u, out.figures);
        if (std::isnan(out.figures.worst))
            return mk_error_set(err, MK_ERR_NUMERIC, "the model runs away under every input");
        // The penalty is finite, so that a good criterion may have bought a little excess. What the
        // plan does at the rate of the loop decides whether it is given away.
        Extent e;
        for (int j = 0; j < MK_MAX_JOINTS; j++) {
            e.q_min[j] = out.figures.q_min[j];
            e.q_max[j] = out.figures.q_max[j];
            e.v_max[j] = out.figures.v_max[j];
        }
        double over = beyond_limits(model, o, e);
        if (over > TOLERATED)
            return mk_error_set(err, MK_ERR_NUMERIC,
                                "no input was found that keeps to the limits, the best leaves them "
                                "by %.2g %%: wider limits, a smaller command, or more tries",
                                100.0 * over);
        out.worst_of_rigs = rigs.size() > 1 && !led ? worst_of_rigs(u) : UNKNOWN;
        return compare(u.size(), err);
    }

  private:
    const mk_model &model;
    const mk_excite_options &o;
    mk_excitation &out;
    std::vector<mk_model> rigs; // that the input is for: the model, and those around it
    std::vector<int> free;
    bool led;
    int threads;

    // How the readings of an experiment with `rate` rows a second are weighed. One row of the
    // search stands for rate_hz / rate readings of the loop, so that C does not depend on the rate
    // it is reckoned at. The process noise bounds the memory of C (docs/identification.md).
    InformationOptions readings(double rate) const
    {
        InformationOptions i;
        std::copy(o.noise, o.noise + MK_MAX_JOINTS, i.noise);
        i.readings_a_row = o.rate_hz / rate;
        i.process_noise = o.process_noise;
        i.step = rate > SEARCH_RATE_HZ ? 2.5e-3 : 5e-3;
        return i;
    }

    // J by the regressor along one period of a trajectory:
    //     log cond(Phi) + OVER (angles and speeds + command + max(0, log(T / seconds))) ,
    // with T = exp(-x_0) the period in s. Infinite where Phi has no full rank.
    double cost_led(const VectorXd &x) const
    {
        Led l = lead(model, series_of(model, x), SEARCH_POINTS);
        double over = beyond_limits(model, o, l.extent) + excess(l.u_max, o.u_max);
        over += std::max(0.0, -x(0) - std::log(o.seconds)); // a period must fit
        return std::log(l.condition(o.criterion == MK_EXCITE_CONDITION)) + OVER * over;
    }

    // The model, and up to MK_EXCITE_RIGS models around it: with r uniform in [-1, 1),
    //     p_i <- p_i (1 + spread r)   for each base parameter ,
    // as far as they make a rig (mass matrix positive definite). Effects stay as they are. A
    // hundred draws at most: where few of them make a rig there may be fewer models.
    void draw_rigs()
    {
        rigs.assign(1, model);
        mk_random random = {o.seed};
        for (int tries = 0; o.spread > 0.0 && tries < 100 && rigs.size() <= MK_EXCITE_RIGS;
             tries++) {
            mk_model rig = model;
            for (int i = 0; i < mk_plant(model.plant)->parameter_count; i++)
                rig.parameter[i] *= 1.0 + o.spread * (2.0 * mk_random_uniform(&random) - 1.0);
            if (mk_model_check(&rig, nullptr) == MK_OK)
                rigs.push_back(rig);
        }
    }

    // J by information: with R rigs m,
    //     1/R sum_m log criterion(C_m) + OVER (frequency + sum_m excess_m) .
    // The mean of logarithms is that of the geometric mean: no rig decides alone. Limits count on
    // every rig. x_0 lies between log(1 / seconds), one period in all, and log(HIGHEST_BASE_HZ);
    // far outside of that nothing is run. Infinite where a rig runs away.
    double cost_input(const VectorXd &x) const
    {
        double rate = std::min(o.rate_hz, SEARCH_RATE_HZ);
        double lowest = std::log(1.0 / o.seconds), highest = std::log(HIGHEST_BASE_HZ);
        double over = std::max(0.0, lowest - x(0)) + std::max(0.0, x(0) - highest);
        if (over > 1.0)
            return 100.0 + over;
        Multisine wave(o.u_max, TWO_PI * std::exp(x(0)), x.tail(x.size() - 1));
        std::vector<double> u = sampled(wave, o.seconds, rate);
        double sum = 0.0;
        for (const mk_model &rig : rigs) {
            PredictedExperiment f = predict_experiment(rig, u, 1.0 / rate, free, readings(rate));
            if (!f.finite())
                return HUGE_VAL;
            over += beyond_limits(rig, o, extent_of(f));
            sum += std::log(value_of(o.criterion, f.covariance));
        }
        return sum / (double)rigs.size() + OVER * over;
    }

    // Wide searches from several frequencies, then a narrow one from the best: CMA-ES finds the
    // bottom of a valley, and which valley it falls into depends on the frequency most. Wide
    // round r = 0, 1, 2 takes 20 % of the evaluations, begins with all amplitudes 0.3 (rad of a
    // series, next to the argument of tanh of a multisine) and
    //     f = max(0.2 1.4^r Hz, 1.5 / seconds) ,   standard deviation 0.5 of every unknown;
    // the narrow one has the other 40 %, the best point so far and 0.1.
    //
    // `best` has 1 + 2 (harmonics - 1) unknowns for a series, whose first harmonic follows from the
    // start at rest, and 1 + 2 harmonics for a multisine. MK_ERR_INTR where progress says stop,
    // MK_ERR_NUMERIC where no point had a finite J.
    enum mk_status search(VectorXd &best, mk_error *err)
    {
        double best_cost = HUGE_VAL, spent = 0.0;
        long unknowns = led ? 2 * o.harmonics - 1 : 2 * o.harmonics + 1;
        for (int round = 0; round <= STARTS; round++) {
            bool last = round == STARTS;
            double share = last ? 1.0 - spent : 0.6 / STARTS;
            CmaOptions c;
            c.evaluations = (long)(share * o.evaluations);
            c.seed = o.seed + (uint64_t)round;
            c.threads = led ? 1 : threads;
            c.spread = last ? 0.1 : 0.5;
            c.progress = [&](double done, double) {
                return !o.progress ||
                       o.progress(o.progress_context, spent + share * done, "searching");
            };
            VectorXd x = VectorXd::Constant(unknowns, 0.3);
            x(0) = std::log(std::max(0.2 * std::pow(1.4, round), 1.5 / o.seconds));
            if (last && best_cost < HUGE_VAL)
                x = best;
            CmaResult r =
                cma_es([&](const VectorXd &y) { return led ? cost_led(y) : cost_input(y); }, x, c);
            if (r.stopped)
                return mk_error_set(err, MK_ERR_INTR, "stopped");
            out.evaluations += (int)r.evaluations;
            spent += share;
            if (r.cost < best_cost) {
                best_cost = r.cost;
                best = r.x;
            }
        }
        if (!(best_cost < HUGE_VAL))
            return mk_error_set(err, MK_ERR_NUMERIC, "the model runs away under every input");
        return MK_OK;
    }

    // The plan of a series over floor(seconds / T) whole periods T, one at least, and its condition
    // numbers at the rate of the loop. A command is held from row to row, so that the one of row k
    // is the torque that the motion needs in the middle of its interval,
    //     u_k = Phi(q, v, a) p   at t_k + 1 / (2 rate) ,   clipped to u_max:
    // the inverse dynamics of the plant, effects left out. Columns q1, dq1, ddq1 are the motion at
    // t_k itself. u is a copy of the command.
    enum mk_status plan_trajectory(const VectorXd &x, std::vector<double> &u, mk_error *err)
    {
        Series series = series_of(model, x);
        out.period = TWO_PI / series.omega;
        out.seconds = out.period * std::max(1.0, std::floor(o.seconds / out.period + 1e-9));
        Led l = lead(model, series, (int)std::lround(out.period * o.rate_hz));
        out.regressor_condition = l.condition(false);
        out.regressor_condition_scaled = l.condition(true);
        size_t rows = (size_t)std::floor(out.seconds * o.rate_hz) + 1;
        double *column[5];
        static const char *const names[5] = {"t", "u", "q1", "dq1", "ddq1"};
        enum mk_status st = make_plan(rows, names, 5, column, err);
        for (size_t k = 0; k < rows && st == MK_OK; k++) {
            double q, v, a;
            column[0][k] = (double)k / o.rate_hz;
            series.at(column[0][k] + 0.5 / o.rate_hz, q, v, a);
            mk_plant_inverse_dynamics(&model, &q, &v, &a, &column[1][k]);
            column[1][k] = std::min(std::max(column[1][k], -o.u_max), o.u_max);
            series.at(column[0][k], column[2][k], column[3][k], column[4][k]);
        }
        if (st == MK_OK)
            u.assign(column[1], column[1] + rows);
        return st;
    }

    // The plan of a multisine: t_k = k / rate and u_k. As text (out.input) the same function can be
    // run as a signal; wave has its frequency and coefficients rounded as the text writes them, so
    // that both are equal. MK_ERR_RANGE where the text does not fit.
    enum mk_status plan_input(const VectorXd &x, std::vector<double> &u, mk_error *err)
    {
        Multisine wave(o.u_max, TWO_PI * std::exp(x(0)), x.tail(x.size() - 1));
        std::string text = wave.text();
        if (text.size() >= sizeof out.input)
            return mk_error_set(err, MK_ERR_RANGE, "fewer harmonics: the input is too long");
        std::memcpy(out.input, text.c_str(), text.size() + 1);
        u = sampled(wave, o.seconds, o.rate_hz);
        double *column[2];
        static const char *const names[2] = {"t", "u"};
        enum mk_status st = make_plan(u.size(), names, 2, column, err);
        for (size_t k = 0; k < u.size() && st == MK_OK; k++) {
            column[0][k] = (double)k / o.rate_hz;
            column[1][k] = u[k];
        }
        return st;
    }

    // A log of `rows` rows in out.plan, which owns the data; column[i] points into it.
    enum mk_status make_plan(size_t rows, const char *const *names, int count, double **column,
                             mk_error *err)
    {
        enum mk_status st = mk_log_create(rows, &out.plan);
        for (int i = 0; i < count && st == MK_OK; i++) {
            column[i] = mk_log_add_column(out.plan, names[i]);
            if (!column[i])
                st = MK_ERR_NOMEM;
        }
        return st == MK_OK ? st : mk_error_set(err, st, "no memory for the plan");
    }

    // What input u, rows 1 / rate_hz apart, does to the model and tells about it. Relative standard
    // errors are sqrt(C_ii): the parameters are scaled by their size (Fit::scale_of). Condition
    // numbers are those of the sensitivities of the readings, not of the regressor. All NaN but
    // u_max where the model runs away.
    void fill(const std::vector<double> &u, mk_excite_figures &f) const
    {
        std::fill(f.std_error, f.std_error + MK_MAX_FIT_PARAMETERS, UNKNOWN);
        f.worst = f.a = f.d = f.condition = f.condition_scaled = UNKNOWN;
        f.u_max = 0.0;
        for (double v : u)
            f.u_max = std::max(f.u_max, std::fabs(v));
        PredictedExperiment s =
            predict_experiment(model, u, 1.0 / o.rate_hz, free, readings(o.rate_hz));
        if (!s.finite())
            return;
        for (size_t i = 0; i < free.size(); i++)
            f.std_error[free[i]] = std::sqrt(s.covariance((long)i, (long)i));
        f.worst = value_of(MK_EXCITE_WORST, s.covariance);
        f.a = value_of(MK_EXCITE_A, s.covariance);
        f.d = value_of(MK_EXCITE_D, s.covariance);
        f.condition = s.condition;
        f.condition_scaled = s.condition_scaled;
        for (int j = 0; j < MK_MAX_JOINTS; j++) {
            f.q_min[j] = s.q_min[j];
            f.q_max[j] = s.q_max[j];
            f.v_max[j] = s.v_max[j];
        }
    }

    // max over the rigs of max_i sqrt(C_ii); infinite where one of them runs away.
    double worst_of_rigs(const std::vector<double> &u) const
    {
        double worst = 0.0;
        for (const mk_model &rig : rigs) {
            PredictedExperiment f =
                predict_experiment(rig, u, 1.0 / o.rate_hz, free, readings(o.rate_hz));
            worst =
                std::max(worst, f.finite() ? value_of(MK_EXCITE_WORST, f.covariance) : HUGE_VAL);
        }
        return worst;
    }

    // The figures of another input over as many rows, clipped to the same limit: `against`, or
    // u_max sin(6 t). Where that runs away its figures are NaN, and that is no error.
    enum mk_status compare(size_t rows, mk_error *err)
    {
        char limit[MK_NUMBER_MAX];
        mk_format_double(limit, o.u_max);
        if (o.against)
            snprintf(out.against, sizeof out.against, "%s", o.against);
        else
            snprintf(out.against, sizeof out.against, "%s*sin(6*t)", limit);
        mk_signal *made = nullptr;
        enum mk_status st = mk_signal_create(out.against, &made, err);
        if (st != MK_OK)
            return st;
        std::unique_ptr<mk_signal, void (*)(mk_signal *)> signal(made, mk_signal_destroy);
        std::vector<double> u(rows);
        for (size_t k = 0; k < rows; k++) {
            double v = mk_signal_at(made, (double)k / o.rate_hz);
            u[k] = std::isfinite(v) ? std::min(std::max(v, -o.u_max), o.u_max) : 0.0;
        }
        fill(u, out.against_figures);
        return MK_OK;
    }
};

enum mk_status check_figures(const mk_model &model, const mk_excite_options &o, mk_error *err)
{
    if (!(o.seconds >= 1.0 && o.seconds <= 600.0))
        return mk_error_set(err, MK_ERR_RANGE, "%g s: from 1 to 600 s", o.seconds);
    if (!(o.rate_hz >= 50.0 && o.rate_hz <= 10000.0))
        return mk_error_set(err, MK_ERR_RANGE, "%g Hz: from 50 to 10000 Hz", o.rate_hz);
    if (o.harmonics < 2 || o.harmonics > MK_EXCITE_MAX_HARMONICS)
        return mk_error_set(err, MK_ERR_RANGE, "%d harmonics: from 2 to %d", o.harmonics,
                            MK_EXCITE_MAX_HARMONICS);
    if (!(o.u_max > 0.0 && o.u_max <= model.u_max))
        return mk_error_set(err, MK_ERR_RANGE, "command limit %g: above 0, at most the rig's %g",
                            o.u_max, model.u_max);
    if (o.evaluations < 100)
        return mk_error_set(err, MK_ERR_RANGE, "%d tries: at least 100", o.evaluations);
    if (!(o.spread >= 0.0 && o.spread <= 0.5))
        return mk_error_set(err, MK_ERR_RANGE, "spread %g: from 0 to 0.5", o.spread);
    if (!(o.process_noise >= 0.0 && std::isfinite(o.process_noise)))
        return mk_error_set(err, MK_ERR_RANGE, "process noise %g: must be 0 or more, and finite",
                            o.process_noise);
    return MK_OK;
}

// A run starts at rest, hanging, so that this has to lie within the limits of the angles. A wheel
// has none.
enum mk_status check_joints(const mk_model &model, const mk_excite_options &o, mk_error *err)
{
    const mk_plant_info *plant = mk_plant(model.plant);
    for (int j = 0; j < plant->joints; j++) {
        bool wheel = plant->joint_is_wheel[j];
        if (!wheel && !(o.q_min[j] < plant->rest[j] && plant->rest[j] < o.q_max[j]))
            return mk_error_set(err, MK_ERR_RANGE,
                                "joint %d: rest at %.4g %s must lie within its limits", j + 1,
                                plant->rest[j], mk_model_unit(&model, j, "rad"));
        if (!(o.v_max[j] > 0.0 && o.noise[j] > 0.0))
            return mk_error_set(err, MK_ERR_RANGE,
                                "joint %d: speed limit and noise must be above 0", j + 1);
    }
    return MK_OK;
}

enum mk_status check(const mk_model &model, const mk_excite_options &o, mk_error *err)
{
    enum mk_status st = check_figures(model, o, err);
    if (st == MK_OK)
        st = check_joints(model, o, err);
    if (st != MK_OK)
        return st;
    if (by_condition(o.criterion) && !fully_actuated(model))
        return mk_error_set(
            err, MK_ERR_NOTSUP,
            "the %s cannot be led along a trajectory: it has a joint without motor; "
            "use criterion worst, a or d",
            mk_plant(model.plant)->name);
    mk_signal *against = nullptr;
    st = o.against ? mk_signal_create(o.against, &against, err) : MK_OK;
    if (st != MK_OK)
        return st;
    mk_signal_destroy(against);
    return mk_model_check(&model, err);
}

} // namespace
} // namespace mk

static const char *const criterion_names[MK_EXCITE_CRITERION_COUNT] = {
    "worst", "a", "d", "condition", "condition-unscaled"};

const char *mk_excite_criterion_name(enum mk_excite_criterion c)
{
    return (unsigned)c < MK_EXCITE_CRITERION_COUNT ? criterion_names[c] : "?";
}

enum mk_excite_criterion mk_excite_criterion_by_name(const char *name)
{
    int i = 0;
    while (i < MK_EXCITE_CRITERION_COUNT && strcmp(criterion_names[i], name) != 0)
        i++;
    return (enum mk_excite_criterion)i;
}

// Of what a carriage has to its stops: the rest is for a rig that goes farther than its model.
static constexpr double TRACK_SHARE = 0.7;

// Limits are well inside those at which a run is stopped: angles half a turn either way, speeds
// 0.4 of the limit, the command 0.7. A reading's error is that of rounding to whole counts, uniform
// over one count c, whose standard deviation is c / sqrt(12).
void mk_excite_default(const mk_model *model, mk_excite_options *out)
{
    const mk_plant_info *plant = mk_plant(model->plant);
    *out = {};
    out->criterion = mk::fully_actuated(*model) ? MK_EXCITE_CONDITION : MK_EXCITE_WORST;
    out->seconds = 10.0;
    out->rate_hz = 500.0;
    out->harmonics = mk::fully_actuated(*model) ? 5 : 8;
    // The report found the rig lifting off its table at 80 % of the limit.
    out->u_max = 0.7 * model->u_max;
    mk_safety_limits safety;
    mk_safety_default(model, 1.0 / out->rate_hz, &safety);
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        double rest = j < plant->joints ? plant->rest[j] : 0.0;
        bool track = plant->joint_motion[j] == MK_JOINT_SLIDES;
        double reach = track ? TRACK_SHARE * plant->joint_travel[j]
                             : 0.5 * mk::TWO_PI * mk_model_joint_scale(model, j);
        out->q_min[j] = rest - reach;
        out->q_max[j] = rest + reach;
        out->v_max[j] = 0.4 * safety.v_max[j];
        // Rounding to whole counts.
        out->noise[j] = mk_model_count(model, j) / std::sqrt(12.0);
    }
    out->process_noise = 1e-4;
    out->evaluations = 9000;
    out->seed = 1;
}

enum mk_status mk_excite(const mk_model *model, const mk_excite_options *options,
                         mk_excitation *out, mk_error *err)
{
    auto begin = std::chrono::steady_clock::now();
    enum mk_status st = mk::check(*model, *options, err);
    if (st != MK_OK)
        return st;
    // Made apart and copied at the end: *out is untouched by a failure, and what it points to is
    // the caller's after a success.
    auto made = std::make_unique<mk_excitation>();
    made->model = *model;
    made->criterion = options->criterion;
    made->seconds = options->seconds;
    made->rate_hz = options->rate_hz;
    made->period = made->regressor_condition = made->regressor_condition_scaled = mk::UNKNOWN;
    try {
        st = mk::Excitation(*model, *options, *made).run(err);
    } catch (const std::bad_alloc &) {
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory to search in");
    }
    if (st != MK_OK) {
        mk_excitation_clear(made.get());
        return st;
    }
    std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begin;
    made->seconds_taken = taken.count();
    *out = *made;
    return MK_OK;
}

void mk_excitation_clear(mk_excitation *e)
{
    mk_log_free(e->plan);
    e->plan = nullptr;
}

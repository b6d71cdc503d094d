// Output error: maximum likelihood of the measured angles themselves (docs/identification.md).
//
// The cost is minus the log likelihood of all readings. Multiple shooting (H. G. Bock 1987; L.
// Ljung, System Identification, ch. 7) with the states eliminated makes of it, in a step d of the
// scaled parameters p_i = p_i0 + scale_i d_i,
//     cost(d) = cost - g'd + d'H d / 2 ,
// H the information matrix (n x n for n free parameters; ident/fit.cpp). This file is what lies
// around that minimisation:
//     rows      which are fitted: pieces between holes, a million at most ;
//     start     values that the fit finds its way from (first_values), and for long data a first
//               fit to few of the logs ;
//     way       from much process noise to little (go_down); the intensity D at which the
//               likelihood is largest says how much the model lacks ;
//     check     by free runs, where the model does not follow its data ;
//     result    standard errors, condition numbers, and what the data do not say.
//
// A right model ends with D near LEAST_PROCESS_NOISE. The inverse of H is then the Cramer-Rao bound
// of the covariance: no unbiased estimate has less. With a large D standard errors count the noise
// and not what the model lacks, and are no bounds of anything; the warnings say so.
#include <algorithm>
#include <cmath>
#include <limits>

#include "base/dense.hpp"
#include "base/parallel.hpp"
#include "ident/first_values.hpp"
#include "ident/fit.hpp"
#include "ident/free_runs.hpp"
#include "ident/method.hpp"
#include "sim/period.hpp"

namespace mk
{

namespace
{

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();

// Numbers of the parameters that the fit moves: those of a law that can be fitted, less the ones
// that the caller holds.
std::vector<int> free_parameters(const IdentProblem &problem)
{
    std::vector<int> free;
    for (int number : fitted_parameters(problem.model))
        if (!problem.options.fixed[number])
            free.push_back(number);
    return free;
}

// cond(J) of the sensitivities J of the weighted readings, where H = J'J:
//     cond(J) = sqrt(largest eigenvalue of H / least one) .
// Infinite where the data leave a combination of parameters open, 1 without parameters.
double condition(const Eigen::MatrixXd &information)
{
    if (information.rows() == 0)
        return 1.0;
    Eigen::VectorXd e = dense::eigenvalues(information);
    return e(0) > 0.0 ? std::sqrt(e(e.size() - 1) / e(0)) : HUGE_VAL;
}

// An inertia or a moment that was given and is about 0 now, for all that the data say: a rig has
// weight.
void warn_if_nothing_is_left(const IdentProblem &problem, int number, mk_ident_result &r)
{
    constexpr double NEAR = 2.0, SURE = 4.0; // standard errors
    const mk_ident_parameter &p = r.parameter[number];
    const double given = mk_model_parameter(&problem.model, number);
    if (p.excited && number < mk_plant(problem.model.plant)->mass_count &&
        !problem.options.unknown[number] && std::fabs(p.value) < NEAR * p.std_error &&
        std::fabs(given) > SURE * p.std_error)
        warn(r,
             "nothing is left of %s, given as %g: something that the model lacks is in its place",
             p.name, given);
}

// Standard errors, correlations and what the data do not say, from the information matrix H. With
// S = diag(scale) and R = diag(sqrt(H_ii)),
//     C = S H^-1 S                covariance, in the parameters' units ,
//     std_error_i = sqrt(C_ii) ,
//     condition numbers of S^-1 H S^-1 (parameters in their units) and of R^-1 H R^-1 (columns of
//     the sensitivities scaled to unit norm) .
// A parameter is excited if its standard error is below its value or, where it may be nothing,
// below 0.3 of its scale. C goes row by row into r.covariance, at the parameters' numbers; rows of
// held ones stay as they are.
void judge(const IdentProblem &problem, const FitPoint &point, const QuadraticModel &quadratic,
           const std::vector<int> &free, mk_ident_result &r)
{
    long n = (long)free.size();
    Eigen::VectorXd scale(n), root(n);
    for (long i = 0; i < n; i++) {
        scale(i) = Fit::scale_of(point.model, free[(size_t)i]);
        root(i) = std::sqrt(std::max(quadratic.information(i, i), 1e-300));
    }
    Eigen::MatrixXd unit =
        root.cwiseInverse().asDiagonal() * quadratic.information * root.cwiseInverse().asDiagonal();
    Eigen::MatrixXd physical = scale.cwiseInverse().asDiagonal() * quadratic.information *
                               scale.cwiseInverse().asDiagonal();
    r.condition_number = condition(physical);
    r.condition_number_scaled = condition(unit);
    Eigen::MatrixXd cov = Fit::covariance(point.model, quadratic, free);
    int count = r.parameter_count;
    // H_ii is the square of how many standard deviations the readings move when the parameter
    // changes by its scale: 1e-6 is nothing, whatever the inverse makes of it.
    for (long i = 0; i < n; i++) {
        mk_ident_parameter &p = r.parameter[free[(size_t)i]];
        double variance = cov(i, i);
        bool known =
            std::isfinite(variance) && variance > 0.0 && quadratic.information(i, i) > 1e-6;
        p.std_error = p.crb = known ? std::sqrt(variance) : UNKNOWN;
        const mk_parameter_info *info =
            mk_model_parameter_info(&point.model, free[(size_t)i], nullptr, 0);
        // Friction or an effect may be nothing, and that is known then; a mass is more than
        // nothing.
        const double usual = info->min > 0.0 ? 0.0 : 0.3 * scale(i);
        p.excited = known && p.std_error < std::max(std::fabs(p.value), usual);
        double slack = 1e-9 * std::max(1.0, std::fabs(p.value));
        p.at_bound = p.value <= info->min + slack || p.value >= info->max - slack;
        // Of values per log the mean may be anything.
        if (!(mk_model_parameter_spread(&point.model, free[(size_t)i]) > 0.0))
            warn_if_not_excited(r, p);
        warn_if_nothing_is_left(problem, free[(size_t)i], r);
        if (p.at_bound)
            warn(r, "%s is at the end of its physical range", p.name);
        for (long k = 0; k < n; k++)
            r.covariance[free[(size_t)i] * count + free[(size_t)k]] = cov(i, k);
    }
}

// Rows that are fitted, of all logs together: what a fit may cost in memory and time.
constexpr size_t MOST_ROWS = 1000000;

// The logs as they are fitted: in pieces where they have holes, and of each at most the first rows.
// Where there are too many, every log gets an equal share of the rows that are left, so that what a
// short log does not need goes to those behind it. The logs own copies of their rows; `source` is
// the number of the record that a piece is of.
std::vector<FitLog> fit_logs(const IdentProblem &problem, mk_ident_result &r)
{
    size_t all = 0, left = MOST_ROWS, logs_left = problem.records.size();
    double hole = 0.0;
    for (const mk_record &record : problem.records)
        all += record.rows;
    std::vector<FitLog> logs;
    for (size_t i = 0; i < problem.records.size(); i++) {
        const mk_record &record = problem.records[i];
        size_t rows = all > MOST_ROWS ? std::min(record.rows, left / logs_left) : record.rows;
        for (const Piece &piece : pieces_of(record, record.rows, hole))
            if (piece.first + Piece::FEWEST_ROWS <= rows)
                logs.push_back(fit_log(record, problem.model, piece.first,
                                       std::min(piece.last, rows), (int)i));
        left -= std::min(left, rows);
        logs_left--;
    }
    if (all > MOST_ROWS)
        warn(r, "of %zu rows the first %zu are fitted: more would say little", all,
             MOST_ROWS - left);
    if (hole > 0.0)
        warn(r, "the command is missing for up to %.3g s: the data are fitted in %zu piece%s", hole,
             logs.size(), logs.size() == 1 ? "" : "s");
    return logs;
}

// Data on which the way from the given parameters is gone, when there is much more.
constexpr size_t SCOUT_ROWS = 8000;
// Relative standard error up to which they may start the fit of all.
constexpr double SCOUT_ERROR = 0.1;
// At which a log is one trajectory.
constexpr double LEAST_PROCESS_NOISE = 1e-5;

// The whole way from a point to the process-noise intensity D of largest likelihood, `first` being
// where it begins. First the direct solve, from `first` to the least D at once, which is enough for
// a right model; else the continuation, D falling by factors of ten (ident/fit_minimise.cpp). The
// direct solve is tried at the ends only: from 1 up nothing is known of the model, from the least D
// a first fit says that it is right; in between it says that it is not. False when the model cannot
// follow the data at all; `point` is then of no use. On success point and quadratic model are those
// of the minimum, and fit.options.process_noise has D.
bool go_down(Fit &fit, const std::vector<int> &free, double first, FitPoint &point,
             QuadraticModel &quadratic)
{
    constexpr double LEAST = 1.5 * LEAST_PROCESS_NOISE;
    FitPoint straight = point;
    if ((first >= 1.0 || first < LEAST) &&
        fit.solve_directly(straight, free, first, LEAST_PROCESS_NOISE, quadratic)) {
        point = std::move(straight);
        return true;
    }
    // What the scouts' logs followed without process noise these do not: from the top.
    const double top = first < LEAST ? 1.0 : std::min(10.0 * first, 1.0);
    return !fit.cancelled &&
           fit.continue_over_process_noise(point, free, top, LEAST_PROCESS_NOISE, quadratic);
}

// What the first logs say, some SCOUT_ROWS rows: where the model's parameters, the noise and the
// step ended, and the process noise at which it follows them. The way costs as many passes over the
// data as with all of them, each a fraction as long, and the fit of all then starts near its end.
// False when there is too little beyond them to be worth it (less than four times as many rows in
// all), or when they do not know every parameter well, sqrt(C_ii) < SCOUT_ERROR scale_i: a start
// that the first logs leave open may be far from what the others say.
bool scout(const std::vector<const FitLog *> &views, const std::vector<int> &free,
           const FitOptions &options, const mk_model &model, FitPoint &point, double &process_noise)
{
    std::vector<const FitLog *> first;
    size_t rows = 0, all = 0;
    for (const FitLog *log : views) {
        if (rows < SCOUT_ROWS) {
            first.push_back(log);
            rows += log->rows();
        }
        all += log->rows();
    }
    if (all < 4 * rows)
        return false;
    Fit fit(first, options);
    point = fit.start(model);
    QuadraticModel quadratic;
    if (!go_down(fit, free, 1.0, point, quadratic))
        return false;
    Eigen::MatrixXd cov = Fit::covariance(point.model, quadratic, free);
    for (size_t i = 0; i < free.size(); i++) {
        double variance = cov((long)i, (long)i);
        double most = SCOUT_ERROR * Fit::scale_of(point.model, free[i]);
        if (!(variance > 0.0 && variance < most * most))
            return false;
    }
    process_noise = fit.options.process_noise[0];
    return true;
}

// Process noise beyond which the model is not the whole truth, rad/s per sqrt(s): an honest rig's
// backlash and cables stay below. The continuation visits 1, 0.1, 0.01, ...: the bounds are just
// below its steps, so that a D of 0.01 is suspicious and one of 1 hopeless.
constexpr double SUSPICIOUS_PROCESS_NOISE = 0.009, HOPELESS_PROCESS_NOISE = 0.9;
constexpr double NOISY = 3.0; // times what the readings scatter

void warn_of_process_noise(double process_noise, mk_ident_result &r)
{
    const int motor = mk_plant(r.model.plant)->motor_joint;
    warn(r,
         "the model follows these data only with a process noise of %.0e %s: "
         "mechkit explain looks for what it lacks",
         process_noise * mk_model_joint_scale(&r.model, motor),
         mk_model_unit(&r.model, motor, "rad/s per sqrt(s)"));
}

// Standard errors are those of readings whose errors are independent: not so where a motion comes
// by the same counts again and again, and rounding with it. With V readings at one place, and a
// share rho of their variance sigma^2 that is the same at each visit, the variance of their mean is
//     sigma^2 (rho + (1 - rho) / V) ~ sigma^2 / V (1 + rho V)   for V >> 1 ,
// sqrt(1 + rho V) times the standard error of independent ones.
void warn_of_repetition(const std::vector<const FitLog *> &views, mk_ident_result &r)
{
    constexpr double SUSPICIOUS = 2.0;
    double share = 0.0;
    for (const FitLog *log : views)
        share = std::max({share, log->repeating[0], log->repeating[log->joints - 1]});
    const double more = std::sqrt(1.0 + share * (double)usual_visits(views));
    if (more < SUSPICIOUS)
        return;
    warn(r,
         "the motion repeats itself, and with it the encoders' rounding: errors may be some "
         "%.0f times the standard errors. Vary the command",
         more);
}

size_t unknown(const std::vector<int> &free, const mk_ident_result &r)
{
    return (size_t)std::count_if(free.begin(), free.end(),
                                 [&](int i) { return !r.parameter[i].excited; });
}

// A fit that starts from a model's values; false when it cannot follow the data from there.
bool fit_from(Fit &fit, const std::vector<const FitLog *> &views, const std::vector<int> &free,
              const mk_model &start, FitPoint &point, QuadraticModel &quadratic)
{
    FitPoint scouted;
    double process_noise = 1.0;
    const bool known = scout(views, free, fit.options, start, scouted, process_noise);
    point = fit.start(known ? scouted.model : start);
    if (known) {
        std::copy(std::begin(scouted.noise), std::end(scouted.noise), std::begin(point.noise));
        point.step = scouted.step;
    }
    return go_down(fit, free, process_noise, point, quadratic);
}

constexpr double RUN_S = 0.5; // of a free run

// How much of the motion free runs miss: squared errors of free runs over those of the readings
// about their mean; the worst joint's root. With S_wj the squared error of window w (counts^2),
// n_wj its readings and sd_j the standard deviation of all readings,
//     max_j count_j sqrt(sum_w S_wj / sum_w n_wj) / sd_j :
// 1 is no better than a constant. Windows that cannot be run do not take part; 0 if none can.
double missed_by(const FreeRuns &runs, const RunQuadraticModel &quadratic, const mk_model &model)
{
    double most = 0.0;
    for (int j = 0; j < mk_model_joints(&model); j++) {
        const double count = mk_model_count(&model, j);
        double squares = 0.0, readings = 0.0; // in counts
        for (const WindowQuadratic &q : quadratic.window)
            if (q.finite)
                squares += q.before[j], readings += (double)q.readings[j];
        if (readings > 0.0)
            most = std::max(most, runs.relative(j, count * std::sqrt(squares / readings)));
    }
    return most;
}

bool any_unknown(const IdentProblem &problem, const std::vector<int> &free)
{
    return std::any_of(free.begin(), free.end(),
                       [&](int number) { return problem.options.unknown[number]; });
}

// What free runs say of a fit whose model does not follow every reading.
struct RunCheck {
    double missed = UNKNOWN;     // nrmse
    bool instead = false;        // they were fitted
    double beyond_scatter = 0.0; // the fitted noise, over what the readings scatter
};

// Where the model lacks much, the likelihood of every reading may lead far away from them: into a
// noise that is as large as the motion. Free runs over windows show it, and are fitted then, from
// where the fit started: the given values, or what was put in the place of unknown ones.
//
// Both points are judged by one cost, that of free runs in units of the errors that are usual about
// the start (FreeRuns::cost, a log likelihood). Only where
//     cost(fitted) >= cost(start) + ASTRAY ,
// or the fitted model cannot be run at all, is it given up for a fit of free runs; `point`,
// `quadratic` and `check` are then of that one. Else only `check` is filled. With values per log
// the fit stays in any case: free runs would have others, and `own` belongs to the fit.
void check_by_runs(const IdentProblem &problem, const mk_model &start, const std::vector<int> &free,
                   int threads, FitPoint &point, QuadraticModel &quadratic, RunCheck &check)
{
    constexpr double ASTRAY = 50.0; // log likelihood of independent errors: beyond doubt
    std::vector<std::vector<const mk_log *>> folds;
    for (const mk_log *log : problem.logs)
        folds.push_back({log});
    FreeRuns runs(folds, start, RUN_S, threads);
    RunPoint fitted = runs.start(point.model);
    // A log of which nothing could be fitted has no values of its own.
    for (size_t log = 0; log < std::min(point.own.size(), fitted.own.size()); log++)
        if (point.own[log].size() == fitted.own[log].size())
            fitted.own[log] = point.own[log];
    RunQuadraticModel about_fitted;
    const bool runs_at_all = runs.linearise(fitted, free, true, threads, about_fitted);
    if (runs_at_all)
        check.missed = missed_by(runs, about_fitted, start);
    if (!point.own.empty())
        return;
    RunPoint given = runs.start(start);
    runs.take_scale(given);
    RunQuadraticModel about_given;
    if (!runs.linearise(given, free, true, threads, about_given) ||
        (runs_at_all && runs.cost(fitted, about_fitted) < runs.cost(given, about_given) + ASTRAY) ||
        !runs.converge(given, free, threads, about_given))
        return;
    point.model = given.model;
    quadratic = runs.information(given, about_given);
    check.missed = missed_by(runs, about_given, start);
    check.instead = true;
}

// In the order of how bad it is: another rig; a little process noise beside readings that scatter
// as they should; everything between, with the share of the motion that is missed.
void warn_of_misfit(const RunCheck &runs, double process_noise, mk_ident_result &r)
{
    constexpr double MUCH = 0.3; // nrmse from which it is another rig
    if (runs.instead)
        warn(r,
             "by the likelihood of every reading a fit leaves these data: it was fitted to free "
             "runs of %g s",
             RUN_S);
    if (!(runs.missed < MUCH))
        warn(r, "the model does not follow these data: is it this rig, with these units, signs "
                "and columns?");
    else if (process_noise >= SUSPICIOUS_PROCESS_NOISE && !runs.instead &&
             process_noise < HOPELESS_PROCESS_NOISE && runs.beyond_scatter < NOISY)
        warn_of_process_noise(process_noise, r);
    else
        warn(r,
             "the model does not follow these data: free runs of %g s miss %.2g %% of the motion, "
             "far "
             "more than the readings' noise, and standard errors do not count it: mechkit explain "
             "looks for what it lacks",
             RUN_S, 100.0 * runs.missed);
}

// The fit from the best start that leads anywhere; `begun`: which that is.
enum mk_status find_minimum(Fit &fit, const IdentProblem &problem,
                            const std::vector<const FitLog *> &views, const std::vector<int> &free,
                            mk_model &begun, FitPoint &point, QuadraticModel &quadratic,
                            mk_error *err)
{
    if (free.empty())
        return mk_error_set(err, MK_ERR_RANGE, "every parameter is held: there is nothing to fit");
    if (views.empty())
        return mk_error_set(err, MK_ERR_RANGE,
                            "no %zu rows without a hole: there is nothing to fit",
                            Piece::FEWEST_ROWS);
    bool found = false;
    for (const mk_model &start : first_values(problem, views, fit.options, BETTER_START))
        if (!found && !fit.cancelled) {
            begun = start;
            found = fit_from(fit, views, free, start, point, quadratic);
        }
    if (found)
        return MK_OK;
    return fit.cancelled
               ? mk_error_set(err, MK_ERR_INTR, "stopped")
               : mk_error_set(err, MK_ERR_NUMERIC,
                              "the model cannot follow the data from these parameters: are the "
                              "units and the rig right?");
}

// Refused is what no fit can be made of: a joint that does not move while the model does not
// follow, or data that say little about most parameters.
enum mk_status refuse_hopeless(const IdentProblem &problem, double process_noise,
                               const std::vector<int> &free, const mk_ident_result &r,
                               mk_error *err)
{
    for (int j = 0; j < mk_model_joints(&r.model); j++)
        if (process_noise >= HOPELESS_PROCESS_NOISE && !problem.moves[j])
            return mk_error_set(err, MK_ERR_NUMERIC,
                                "the model does not follow these data, in which q%d does not move: "
                                "is the joint stuck, or its encoder?",
                                j + 1);
    if (process_noise >= SUSPICIOUS_PROCESS_NOISE && 2 * unknown(free, r) > free.size())
        return mk_error_set(err, MK_ERR_NUMERIC,
                            "the model does not follow these data, which say little about most of "
                            "its parameters: is it this rig, with these units, signs and columns?");
    return MK_OK;
}

// Standard deviation of a reading by joint, rad. What a model that does not follow its data misses
// is no noise of the readings: there it is no more than their own fast scatter.
void tell_noise(const std::vector<const FitLog *> &views, const FitPoint &point, bool follows,
                mk_ident_result &r)
{
    std::fill(std::begin(r.noise), std::end(r.noise), UNKNOWN);
    for (int j = 0; j < mk_model_joints(&r.model); j++)
        r.noise[j] = follows ? point.noise[j] : std::min(point.noise[j], scatter_of(views, j));
}

// The method: rows, minimum, check, result. `views` point into `logs`, and the fit keeps them; all
// live to the end of this function. r.rows counts readings of all joints that have a weight, not
// rows of the logs. Where the fit is refused r is filled all the same. MK_ERR_RANGE,
// MK_ERR_NUMERIC, MK_ERR_INTR.
enum mk_status run(const IdentProblem &problem, mk_ident_result &r, mk_error *err)
{
    std::vector<FitLog> logs = fit_logs(problem, r);
    std::vector<const FitLog *> views;
    for (const FitLog &log : logs) {
        views.push_back(&log);
        for (int j = 0; j < log.joints; j++)
            r.rows += std::count_if(log.weight[j].begin(), log.weight[j].end(),
                                    [](double w) { return w > 0.0; });
    }
    FitOptions options;
    options.threads = threads_for(problem.options.threads);
    Fit fit(views, options);
    fit.progress = problem.options.progress;
    fit.progress_context = problem.options.progress_context;
    const std::vector<int> free = free_parameters(problem);
    FitPoint point;
    QuadraticModel quadratic;
    mk_model begun;
    enum mk_status st = find_minimum(fit, problem, views, free, begun, point, quadratic, err);
    if (st != MK_OK)
        return st;
    // Two signs of a model that does not follow: process noise, and a fitted noise far above the
    // scatter, into which a wrong zero goes without any process noise. Own values are taken before
    // the check, which may replace the quadratic model that they belong to.
    const double process_noise = fit.options.process_noise[0];
    const std::vector<OwnValue> own = fit.own_values(point, quadratic);
    RunCheck runs;
    runs.beyond_scatter = beyond_scatter(views, point.noise);
    const bool follows = process_noise < SUSPICIOUS_PROCESS_NOISE && runs.beyond_scatter < NOISY;
    if (!follows)
        check_by_runs(problem, any_unknown(problem, free) ? begun : problem.model, free,
                      options.threads, point, quadratic, runs);
    r.model = point.model;
    r.cost = quadratic.cost;
    r.iterations = fit.iterations;
    r.converged = fit.converged;
    tell_noise(views, point, follows, r);
    for (int i = 0; i < r.parameter_count; i++)
        r.parameter[i].value = mk_model_parameter(&r.model, i);
    for (const OwnValue &v : own)
        if (r.own_count < MK_MAX_OWN_VALUES)
            r.own[r.own_count++] = {v.number, (size_t)v.source, v.value, v.std_error};
    if (!follows)
        warn_of_misfit(runs, process_noise, r);
    if (process_noise < SUSPICIOUS_PROCESS_NOISE)
        warn_of_repetition(views, r);
    judge(problem, point, quadratic, free, r);
    return refuse_hopeless(problem, process_noise, free, r, err);
}

} // namespace

const IdentMethod method_output_error = {
    {"output-error", "maximum likelihood of the measured angles, effects included (default)",
     "Bock 1987; Ljung, System Identification, ch. 7", true},
    run};

} // namespace mk

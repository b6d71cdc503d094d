// Output error: maximum likelihood of the measured angles themselves.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <thread>

#include "ident/fit.hpp"
#include "ident/method.hpp"

namespace mk
{

namespace
{

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();

std::vector<int> free_parameters(const IdentProblem &problem)
{
    std::vector<int> free;
    for (int number : fitted_parameters(problem.model))
        if (!problem.options.fixed[number])
            free.push_back(number);
    return free;
}

void warn(mk_ident_result &r, const std::string &text)
{
    if (r.warning_count < MK_MAX_FIT_WARNINGS)
        snprintf(r.warning[r.warning_count++], sizeof r.warning[0], "%s", text.c_str());
}

double condition(const Eigen::MatrixXd &information)
{
    if (information.rows() == 0)
        return 1.0;
    Eigen::VectorXd e = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(information).eigenvalues();
    return e(0) > 0.0 ? std::sqrt(e(e.size() - 1) / e(0)) : HUGE_VAL;
}

// Standard errors, correlations and what the data do not say, from the information matrix.
void judge(const FitPoint &point, const FitPicture &picture, const std::vector<int> &free,
           mk_ident_result &r)
{
    long n = (long)free.size();
    Eigen::VectorXd scale(n), root(n);
    for (long i = 0; i < n; i++) {
        scale(i) = Fit::scale_of(point.model, free[(size_t)i]);
        root(i) = std::sqrt(std::max(picture.information(i, i), 1e-300));
    }
    Eigen::MatrixXd unit =
        root.cwiseInverse().asDiagonal() * picture.information * root.cwiseInverse().asDiagonal();
    Eigen::MatrixXd physical =
        scale.cwiseInverse().asDiagonal() * picture.information * scale.cwiseInverse().asDiagonal();
    r.condition_number = condition(physical);
    r.condition_number_scaled = condition(unit);
    Eigen::MatrixXd cov = Fit::covariance(point.model, picture, free);
    int count = r.parameter_count;
    for (long i = 0; i < n; i++) {
        mk_ident_parameter &p = r.parameter[free[(size_t)i]];
        double variance = cov(i, i);
        bool known = std::isfinite(variance) && variance > 0.0 && picture.information(i, i) > 1e-6;
        p.std_error = p.crb = known ? std::sqrt(variance) : UNKNOWN;
        p.excited = known && p.std_error < std::max(std::fabs(p.value), 0.3 * scale(i));
        const mk_parameter_info *info =
            mk_model_parameter_info(&point.model, free[(size_t)i], nullptr, 0);
        double slack = 1e-9 * std::max(1.0, std::fabs(p.value));
        p.at_bound = p.value <= info->min + slack || p.value >= info->max - slack;
        if (!p.excited)
            warn(r,
                 std::string("the data say little about ") + p.name + ": excite it more or fix it");
        if (p.at_bound)
            warn(r, std::string(p.name) + " is at the end of its physical range");
        for (long k = 0; k < n; k++)
            r.covariance[free[(size_t)i] * count + free[(size_t)k]] = cov(i, k);
    }
}

enum mk_status run(const IdentProblem &problem, mk_ident_result &r, mk_error *err)
{
    std::vector<FitLog> logs;
    for (const mk_record &record : problem.records)
        logs.push_back(fit_log(record, problem.model, 0, record.rows));
    std::vector<const FitLog *> views;
    for (const FitLog &log : logs) {
        views.push_back(&log);
        for (int j = 0; j < log.joints; j++)
            for (double w : log.weight[j])
                r.rows += w > 0.0;
    }
    FitOptions options;
    int processors = (int)std::thread::hardware_concurrency();
    options.threads =
        problem.options.threads > 0 ? problem.options.threads : std::max(processors, 1);
    Fit fit(views, options);
    fit.progress = problem.options.progress;
    fit.progress_context = problem.options.progress_context;
    std::vector<int> free = free_parameters(problem);
    if (free.empty())
        return mk_error_set(err, MK_ERR_RANGE, "every parameter is held: there is nothing to fit");
    FitPoint point = fit.start(problem.model);
    FitPicture picture;
    if (!fit.descend(point, free, 1.0, 1e-5, picture)) {
        if (fit.cancelled)
            return mk_error_set(err, MK_ERR_INTR, "stopped");
        return mk_error_set(err, MK_ERR_NUMERIC,
                            "the model cannot follow the data from these parameters: are the units "
                            "and the rig right?");
    }
    r.model = point.model;
    r.cost = picture.cost;
    r.iterations = fit.iterations;
    r.converged = fit.converged;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        r.noise[j] = j < mk_model_joints(&r.model) ? point.noise[j] : UNKNOWN;
    for (int i = 0; i < r.parameter_count; i++)
        r.parameter[i].value = mk_model_parameter(&r.model, i);
    judge(point, picture, free, r);
    return MK_OK;
}

} // namespace

const IdentMethod method_output_error = {
    {"output-error", "maximum likelihood of the measured angles, effects included (default)",
     "Bock 1987; Ljung, System Identification, ch. 7", true},
    run};

} // namespace mk

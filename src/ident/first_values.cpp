#include "ident/first_values.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

namespace mk
{

namespace
{

// Data that models are compared on: some seconds show inertias and weights.
constexpr size_t MOST_ROWS = 8000;
// Squared error a reading, in variances of the noise, at which the given model follows the data:
// off by ten standard deviations within a quarter of a second, from where a fit finds its way.
constexpr double FOLLOWS = 100.0;
constexpr double CUTOFFS_HZ[] = {3.0, 10.0}; // of the linear methods: slow rigs, fast ones
constexpr double FACTORS[] = {1.0, 0.1, 10.0};
constexpr size_t MOST_STARTS = 4;

struct Start {
    mk_model model;
    double error; // a reading, in variances of its noise
};

// The first logs, and of a long one its beginning.
std::vector<FitLog> beginnings(const std::vector<const FitLog *> &logs)
{
    std::vector<FitLog> out;
    size_t rows = 0;
    for (const FitLog *log : logs) {
        if (rows >= MOST_ROWS)
            break;
        const size_t left = MOST_ROWS - rows;
        out.push_back(log->rows() > left ? beginning_of(*log, log->t[left]) : *log);
        rows += out.back().rows();
    }
    return out;
}

// Compares models on the same data.
class Contest
{
  public:
    Contest(const std::vector<const FitLog *> &all, const FitOptions &options_in)
        : logs(beginnings(all)), options(options_in)
    {
        constexpr int STATES_ALONE = 5; // steps to where the states stand still
        for (const FitLog &log : logs)
            views.push_back(&log);
        options.max_iterations = STATES_ALONE;
        options.process_noise[0] = options.process_noise[1] = 1.0;
    }
    double error_of(const mk_model &model) const
    {
        Fit fit(views, options);
        FitPoint point = fit.start(model);
        if (!fit.minimise(point, {}))
            return HUGE_VAL;
        double readings = 0.0;
        for (const FitLog &log : logs)
            for (int j = 0; j < log.joints; j++)
                for (double w : log.weight[j])
                    readings += w * w;
        return 2.0 * point.cost / std::max(readings, 1.0);
    }

  private:
    std::vector<FitLog> logs;
    std::vector<const FitLog *> views;
    FitOptions options;
};

// A model as the linear methods leave it, within the physical ranges; false where that makes no
// rig.
bool mend(mk_model &model)
{
    const mk_plant_info &plant = *mk_plant(model.plant);
    for (int i = 0; i < plant.parameter_count; i++) {
        double &p = model.parameter[i];
        if (!std::isfinite(p))
            return false;
        p = std::min(std::max(p, plant.parameter[i].min), plant.parameter[i].max);
    }
    return mk_model_check(&model, nullptr) == MK_OK;
}

// Whether a record has readings of every joint, and not just a few.
bool says_something(const mk_record &record, int joints)
{
    for (int j = 0; j < joints; j++) {
        const double *q = record.q[j];
        const auto readings =
            std::count_if(q, q + record.rows, [](double angle) { return !std::isnan(angle); });
        if ((size_t)readings < Piece::FEWEST_ROWS)
            return false;
    }
    return true;
}

// What a linear method finds on the beginning of the data. Effects keep their values.
bool linear(const IdentProblem &whole, const IdentMethod &method, double cutoff_hz, mk_model &out)
{
    IdentProblem problem = whole;
    problem.logs.clear();
    problem.records.clear();
    problem.options.cutoff_hz = cutoff_hz;
    size_t rows = 0;
    for (size_t i = 0; i < whole.records.size() && rows < MOST_ROWS; i++) {
        mk_record record = whole.records[i];
        record.rows = std::min(record.rows, MOST_ROWS - rows);
        rows += record.rows;
        if (!says_something(record, mk_model_joints(&whole.model)))
            continue; // the few rows of it that are left
        problem.records.push_back(record);
        problem.logs.push_back(whole.logs[i]);
    }
    auto result = std::make_unique<mk_ident_result>();
    result->model = whole.model;
    result->parameter_count = mk_model_parameter_count(&whole.model);
    // Values that make no rig are told as an error, and may be near ones that do.
    if (method.fit(problem, *result, nullptr) != MK_OK && !result->converged)
        return false;
    out = whole.model;
    std::copy_n(result->model.parameter, mk_plant(out.plant)->parameter_count, out.parameter);
    return mend(out);
}

// Those of masses are inertias, in kg m^2, and weights.
enum Group { INERTIA, WEIGHT, FRICTION };
Group group_of(const mk_plant_info &plant, int i)
{
    if (i >= plant.mass_count)
        return FRICTION;
    return std::string(plant.parameter[i].unit) == "kg m^2" ? INERTIA : WEIGHT;
}

std::vector<mk_model> scattered(const IdentProblem &problem)
{
    std::vector<mk_model> out;
    const mk_plant_info &plant = *mk_plant(problem.model.plant);
    for (double inertia : FACTORS)
        for (double weight : FACTORS)
            for (double friction : FACTORS) {
                const double by[] = {inertia, weight, friction};
                mk_model m = problem.model;
                for (int i = 0; i < plant.parameter_count; i++)
                    if (!problem.options.fixed[i])
                        m.parameter[i] *= by[group_of(plant, i)];
                if (mk_model_check(&m, nullptr) == MK_OK)
                    out.push_back(m);
            }
    return out;
}

bool any_unknown(const IdentProblem &problem)
{
    return std::any_of(std::begin(problem.options.unknown), std::end(problem.options.unknown),
                       [](bool unknown) { return unknown; });
}

// The given model, what is unknown of it found beside what was given; false where all is unknown,
// or nothing can be found so.
bool fill_in(const IdentProblem &problem, mk_model &out)
{
    IdentProblem beside = problem;
    bool any_given = false;
    for (int i = 0; i < mk_plant(problem.model.plant)->parameter_count; i++) {
        any_given = any_given || !problem.options.unknown[i];
        beside.options.fixed[i] = problem.options.fixed[i] || !problem.options.unknown[i];
    }
    for (const IdentMethod *method : {&method_olsen, &method_sls})
        for (double cutoff : CUTOFFS_HZ)
            if (any_given && linear(beside, *method, cutoff, out))
                return true;
    return false;
}

// What the linear methods find, or values tried over two orders of magnitude.
std::vector<Start> starts_beside(const IdentProblem &problem, const Contest &contest)
{
    std::vector<Start> starts;
    for (const IdentMethod *method : {&method_olsen, &method_sls})
        for (double cutoff : CUTOFFS_HZ) {
            mk_model m;
            const bool enough = !starts.empty() && starts.back().error < FOLLOWS;
            if (!enough && linear(problem, *method, cutoff, m))
                starts.push_back({m, contest.error_of(m)});
        }
    if (starts.empty())
        for (const mk_model &m : scattered(problem))
            starts.push_back({m, contest.error_of(m)});
    return starts;
}

} // namespace

std::vector<mk_model> first_values(const IdentProblem &problem,
                                   const std::vector<const FitLog *> &logs,
                                   const FitOptions &options, double better)
{
    mk_model as_given = problem.model;
    const bool given = !any_unknown(problem) || fill_in(problem, as_given);
    const Contest contest(logs, options);
    const double error = given ? contest.error_of(as_given) : HUGE_VAL;
    if (given && error < FOLLOWS)
        return {as_given};
    std::vector<Start> starts = starts_beside(problem, contest);
    if (given)
        starts.push_back({as_given, error / better});
    std::stable_sort(starts.begin(), starts.end(),
                     [](const Start &a, const Start &b) { return a.error < b.error; });
    std::vector<mk_model> out;
    for (const Start &start : starts)
        if (out.size() < MOST_STARTS)
            out.push_back(start.model);
    if (out.empty())
        out.push_back(problem.model);
    return out;
}

} // namespace mk

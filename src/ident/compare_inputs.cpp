// mk_compare_inputs: which of a log's columns drives the model, by predictions of logs left out.
//
// What a drive measures of its torque may miss what the rig got (a filter, a gear behind the
// sensor), and what it was sent may come late or slowly. Neither shows in a likelihood as long as
// the model is far from the readings' noise; in predictions of what was not fitted it does.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <new>

#include "base/parallel.hpp"
#include "ident/first_values.hpp"
#include "ident/free_runs.hpp"
#include "ident/left_out.hpp"
#include "ident/owned_log.hpp"
#include "ident/scale.hpp"
#include "sim/period.hpp"
#include "sim/record_check.hpp"

namespace mk
{

namespace
{

constexpr double WINDOW_S = 0.5;  // of free runs: real rigs are hardly predicted for longer
constexpr double ENOUGH_S = 60.0; // of all logs together; of longer ones the middles are taken,
constexpr double FEWEST_S = 5.0;  // and so much of each
constexpr int ITERATIONS = 12, MORE = 6;
constexpr double FIRST_LAG = 0.003; // s, to start from
constexpr double LATE = 3.0;        // standard errors: less is not late
constexpr double LEAST_LAG = 0.2;   // of the time between rows: less is a delay
constexpr double ACCEPT = 12.0;     // log likelihood that makes a difference

int place_of(const mk_model &m, const char *effect)
{
    for (int e = 0; e < m.effect_count; e++)
        if (mk_effect(m.effect[e].index) == mk_effect_by_name(effect))
            return e;
    return -1;
}

// Number of the only parameter of such an effect (mechkit/ident.h).
int number_of(const mk_model &m, const char *effect)
{
    int number = mk_plant(m.plant)->parameter_count;
    for (int e = 0; e < place_of(m, effect); e++)
        number += mk_effect(m.effect[e].index)->parameter_count;
    return number;
}

// One that the model has already stays as it is.
void add(mk_model &m, const char *effect, double value)
{
    if (place_of(m, effect) < 0 && mk_model_add_effect(&m, effect, 0, nullptr) == MK_OK)
        m.effect[m.effect_count - 1].value[0] = value;
}

// A column with what its command needs, fitted to all logs, and what that says of logs left out.
struct Column {
    mk_model start;
    std::vector<OwnedLog> pieces; // of the logs, without holes
    std::unique_ptr<FreeRuns> runs;
    std::vector<int> free;
    double period = HUGE_VAL; // between rows, s
    RunPoint point;
    RunQuadraticModel quadratic;
    QuadraticModel said; // by all logs
    HeldOutFigures left_out;

    double standard_error(const char *effect) const
    {
        const auto place = std::find(free.begin(), free.end(), number_of(point.model, effect));
        if (place_of(point.model, effect) < 0 || place == free.end())
            return std::numeric_limits<double>::quiet_NaN();
        const long at = place - free.begin();
        return std::sqrt(Fit::covariance(point.model, said, free)(at, at));
    }
    double value(const char *effect) const
    {
        const int at = place_of(point.model, effect);
        return at < 0 ? 0.0 : point.model.effect[at].value[0];
    }
    bool is_late(const char *effect) const { return value(effect) > LATE * standard_error(effect); }
};

// Better in every log, or surely on average, or on average where the likelihood of all errors says
// so too: how much better differs more from log to log than whether.
bool predicts_better(const Column &a, const Column &b)
{
    constexpr double LESS = 0.05; // of the squared error must go, at least
    const LogRatio r = ratio_by_log(a.left_out, b.left_out);
    const bool likelier = a.said.nlml < b.said.nlml - ACCEPT && 2 * r.better > r.logs;
    return surely_better(r) || ((likelier || r.better == r.logs) && r.mean < std::log(1.0 - LESS));
}

class Comparison
{
  public:
    Comparison(const mk_model &model_in, const mk_ident_options &options_in)
        : model(model_in), options(options_in)
    {
        options.threads = threads_for(options.threads);
    }

    // Logs in which nothing moves say nothing.
    void take(const mk_log *log)
    {
        mk_record record;
        if (mk_log_has_both_inputs(log, &model) &&
            mk_record_from_log(log, &model, &record, nullptr) == MK_OK &&
            check_record(record, model, *log, Piece::FEWEST_ROWS, nullptr) == MK_OK &&
            record_moves(record, model))
            logs.push_back(log);
    }
    size_t count() const { return logs.size(); }

    enum mk_status run(mk_input_comparison &out, mk_error *err)
    {
        take_middles();
        auto measured = std::make_unique<Column>(), commanded = std::make_unique<Column>();
        enum mk_status st = fit(with_input(MK_INPUT_MEASURED), nullptr, *measured, err);
        if (st == MK_OK)
            st = fit_commanded(*measured, commanded, err);
        if (st == MK_OK)
            decide(*measured, *commanded, out);
        return st;
    }

  private:
    mk_model model;
    mk_ident_options options;
    std::vector<const mk_log *> logs;
    std::vector<OwnedLog> made;

    static double seconds_of(const mk_log &log)
    {
        const double *t = mk_log_get(&log, "t");
        return t && log.rows > 1 ? t[log.rows - 1] - t[0] : 0.0;
    }
    // Of long logs the middles, so that all together are no longer than it takes to tell.
    void take_middles()
    {
        double all = 0.0;
        for (const mk_log *log : logs)
            all += seconds_of(*log);
        for (const mk_log *&log : logs) {
            const double seconds = seconds_of(*log);
            const double kept = std::max(FEWEST_S, seconds * ENOUGH_S / std::max(all, ENOUGH_S));
            const size_t rows = log->rows, some = (size_t)((double)rows * kept / seconds);
            if (some >= rows)
                continue;
            const size_t first = (rows - some) / 2;
            made.push_back(rows_of_log(*log, first, first + some));
            log = made.back().get();
        }
    }
    mk_model with_input(enum mk_input input) const
    {
        mk_model m = model;
        m.input = input;
        return m;
    }
    // Where fits begin, which for a given model that is orders of magnitude off is elsewhere.
    mk_model first_model(const mk_model &m, const std::vector<mk_record> &records) const
    {
        std::vector<FitLog> whole;
        for (size_t i = 0; i < records.size(); i++)
            whole.push_back(fit_log(records[i], m, 0, records[i].rows, (int)i));
        std::vector<const FitLog *> view;
        for (const FitLog &log : whole)
            view.push_back(&log);
        IdentProblem problem = {};
        problem.model = m;
        problem.logs = logs;
        problem.records = records;
        problem.options = options;
        for (const mk_record &record : records)
            for (int j = 0; j < mk_model_joints(&m); j++)
                problem.moves[j] = problem.moves[j] || joint_moves(record, m, j);
        FitOptions o;
        o.threads = options.threads;
        return first_values(problem, view, o, BETTER_START).front();
    }
    // `like`: a column whose fit has values to start from.
    enum mk_status fit(const mk_model &m, const Column *like, Column &out, mk_error *err) const
    {
        out.start = m;
        if (like)
            std::copy_n(like->start.parameter, MK_MAX_PARAMETERS, out.start.parameter);
        enum mk_status st = load(m, like == nullptr, out, err);
        if (st != MK_OK)
            return st;
        RunPoint point = out.runs->start(out.start);
        return converge(std::move(point), out, err);
    }
    // The pieces of every log, which is a fold of its own.
    enum mk_status load(const mk_model &m, bool first, Column &out, mk_error *err) const
    {
        std::vector<mk_record> records(logs.size());
        std::vector<std::vector<const mk_log *>> folds(logs.size());
        for (size_t i = 0; i < logs.size(); i++) {
            enum mk_status st = mk_record_from_log(logs[i], &m, &records[i], err);
            if (st != MK_OK)
                return st;
            double hole = 0.0;
            for (const Piece &piece : pieces_of(records[i], records[i].rows, hole)) {
                out.pieces.push_back(rows_of_log(*logs[i], piece.first, piece.last));
                folds[i].push_back(out.pieces.back().get());
            }
            out.period = std::min(out.period, median_period(records[i].t, records[i].rows));
        }
        if (first)
            out.start = first_model(m, records);
        out.runs = std::make_unique<FreeRuns>(folds, out.start, WINDOW_S, options.threads);
        return MK_OK;
    }
    // From a point of the column's runs to where they are met best, and what that says.
    enum mk_status converge(RunPoint point, Column &out, mk_error *err) const
    {
        out.free.clear();
        for (int number : fitted_parameters(point.model))
            if (!options.fixed[number])
                out.free.push_back(number);
        out.point = std::move(point);
        // What errors are usual is known better the second time.
        for (const int iterations : {ITERATIONS, MORE}) {
            if (options.progress && !options.progress(options.progress_context, 0.0, "fitting"))
                return mk_error_set(err, MK_ERR_INTR, "stopped");
            out.runs->take_scale(out.point);
            if (!out.runs->minimise(out.point, out.free, iterations, options.threads,
                                    out.quadratic))
                return mk_error_set(err, MK_ERR_NUMERIC,
                                    "the model cannot follow the data with the %s column",
                                    mk_input_name(out.start.input));
        }
        out.said = out.runs->information(out.point, out.quadratic);
        const bool halves = mk_model_has_own_values(&model);
        return out.runs->left_out(out.point, out.quadratic, out.free, halves, out.left_out)
                   ? MK_OK
                   : mk_error_set(err, MK_ERR_NUMERIC,
                                  "the model cannot follow a part of the data with the %s column",
                                  mk_input_name(out.start.input));
    }
    // Late, and with a lag as well where that predicts logs left out surely better.
    enum mk_status fit_commanded(const Column &measured, std::unique_ptr<Column> &out,
                                 mk_error *err) const
    {
        mk_model late = with_input(MK_INPUT_COMMANDED);
        add(late, "input-delay", mk_effect_by_name("input-delay")->parameter[0].initial);
        enum mk_status st = fit(late, &measured, *out, err);
        if (st != MK_OK || place_of(model, "actuator-lag") >= 0)
            return st;
        auto slow = std::make_unique<Column>();
        slow->start = out->start;
        slow->period = out->period;
        st = load(late, false, *slow, err);
        mk_model lagging = out->point.model;
        add(lagging, "actuator-lag", FIRST_LAG);
        if (st == MK_OK)
            st = converge(slow->runs->adopt(out->point, lagging, options.threads), *slow, err);
        if (st == MK_OK && slow->is_late("actuator-lag") &&
            slow->value("actuator-lag") > LEAST_LAG * slow->period &&
            slow->said.nlml < out->said.nlml - ACCEPT && predicts_better(*slow, *out))
            out = std::move(slow);
        return st == MK_ERR_NUMERIC ? MK_OK : st;
    }
    void decide(const Column &measured, const Column &commanded, mk_input_comparison &out) const
    {
        const bool said = model.input == MK_INPUT_COMMANDED;
        const LogRatio r = ratio_by_log(commanded.left_out, measured.left_out);
        const bool take =
            said ? !predicts_better(measured, commanded) : predicts_better(commanded, measured);
        out = {};
        out.made = true;
        out.taken = take ? MK_INPUT_COMMANDED : MK_INPUT_MEASURED;
        out.changed = take != said;
        out.logs = r.logs, out.better = r.better;
        out.window_s = WINDOW_S;
        out.ratio = std::exp(r.mean), out.log_error = r.error;
        for (int j = 0; j < mk_model_joints(&model); j++) {
            out.nrmse[MK_INPUT_MEASURED][j] = measured.left_out.nrmse(j);
            out.nrmse[MK_INPUT_COMMANDED][j] = commanded.left_out.nrmse(j);
        }
        out.fitted[MK_INPUT_MEASURED] = measured.point.model;
        out.fitted[MK_INPUT_COMMANDED] = commanded.point.model;
        out.model = with_input(out.taken);
        take_lateness(commanded, take, out);
    }
    static void take_lateness(const Column &commanded, bool taken, mk_input_comparison &out)
    {
        if (commanded.is_late("input-delay")) {
            out.delay = commanded.value("input-delay");
            out.delay_error = commanded.standard_error("input-delay");
            if (taken)
                add(out.model, "input-delay", out.delay);
        }
        if (commanded.is_late("actuator-lag")) {
            out.lag = commanded.value("actuator-lag");
            out.lag_error = commanded.standard_error("actuator-lag");
            if (taken)
                add(out.model, "actuator-lag", out.lag);
        }
    }
};

} // namespace

} // namespace mk

bool mk_log_has_both_inputs(const mk_log *log, const mk_model *model)
{
    for (int i = MK_INPUT_MEASURED; i < MK_INPUT_COUNT; i++) {
        mk_model m = *model;
        mk_record record;
        m.input = (enum mk_input)i;
        if (mk_record_from_log(log, &m, &record, nullptr) != MK_OK || !record.u[0])
            return false;
    }
    return true;
}

enum mk_status mk_compare_inputs(const mk_model *model, const mk_log *const *logs, size_t log_count,
                                 const mk_ident_options *options, mk_input_comparison *out,
                                 mk_error *err)
try {
    enum mk_status st = mk_model_check(model, err);
    if (st != MK_OK)
        return st;
    const mk_ident_options o = options ? *options : mk_ident_options{};
    std::vector<const mk_log *> used(logs, logs + log_count);
    std::vector<mk::OwnedLog> made;
    mk_left_out left_out[MK_MAX_LEFT_OUT];
    int left_out_count = 0;
    st = mk::leave_out(*model, o.rows, used, made, left_out, &left_out_count, err);
    if (st != MK_OK)
        return st;
    mk::Comparison comparison(*model, o);
    for (const mk_log *log : used)
        comparison.take(log);
    if (comparison.count() < 2)
        return mk_error_set(err, MK_ERR_RANGE,
                            "to compare the commanded with the measured column two logs are needed "
                            "at least that have both (u_cmd beside u, tau_cmd beside tau, ...) and "
                            "in which something moves");
    return comparison.run(*out, err);
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory to compare the columns of this much data");
}

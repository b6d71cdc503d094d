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
#include <thread>

#include "base/parallel.hpp"
#include "ident/first_values.hpp"
#include "ident/fit.hpp"
#include "ident/held_out.hpp"
#include "ident/left_out.hpp"
#include "ident/scale.hpp"
#include "sim/record_check.hpp"

namespace mk
{

namespace
{

constexpr double WINDOW_S = 0.5;    // of free runs: real rigs are hardly predicted for longer
constexpr size_t MOST_FOLDS = 8;    // fits without a part of the logs
constexpr size_t MOST_ROWS = 40000; // that are fitted, of all logs together
constexpr double LOOSEST = 10.0, TIGHTEST = 1e-4; // drift, rad/s per sqrt(s)
constexpr double MOST_PASSES = 1000.0;            // of a fit
constexpr double FIRST_LAG = 0.003;               // s, to start from
constexpr double LATE = 3.0;                      // standard errors: less is not late
constexpr double LEAST_LAG = 0.2;                 // of the time between rows: less is a delay
constexpr double ENOUGH = 12.0;                   // log likelihood that a lag must gain

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
    std::vector<FitLog> logs;
    std::vector<int> free;
    FitPoint point;
    FitPicture picture;
    double drift = 0.0;
    HeldOutFigures left_out;

    double standard_error(const char *effect) const
    {
        const auto place = std::find(free.begin(), free.end(), number_of(point.model, effect));
        if (place_of(point.model, effect) < 0 || place == free.end())
            return std::numeric_limits<double>::quiet_NaN();
        const long at = place - free.begin();
        return std::sqrt(Fit::covariance(point.model, picture, free)(at, at));
    }
    double value(const char *effect) const
    {
        const int at = place_of(point.model, effect);
        return at < 0 ? 0.0 : point.model.effect[at].value[0];
    }
    bool is_late(const char *effect) const { return value(effect) > LATE * standard_error(effect); }
};

// Better in every log, or surely on average: how much better differs more from log to log than
// whether.
bool predicts_better(const Column &a, const Column &b)
{
    constexpr double LESS = 0.05; // of the squared error must go, at least
    const LogRatio r = ratio_by_log(a.left_out, b.left_out);
    return surely_better(r) || (r.better == r.logs && r.mean < std::log(1.0 - LESS));
}

class Comparison
{
  public:
    Comparison(const mk_model &model_in, const mk_ident_options &options_in)
        : model(model_in), options(options_in)
    {
        if (options.threads <= 0)
            options.threads = std::max(1, (int)std::thread::hardware_concurrency());
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
        auto measured = std::make_unique<Column>(), commanded = std::make_unique<Column>();
        enum mk_status st = fit(with_input(MK_INPUT_MEASURED), nullptr, *measured, err);
        if (st == MK_OK)
            st = fit_commanded(*measured, commanded, err);
        if (st == MK_OK)
            st = leave_out(*measured, err);
        if (st == MK_OK)
            decide(*measured, *commanded, out);
        return st;
    }

  private:
    mk_model model;
    mk_ident_options options;
    std::vector<const mk_log *> logs;

    mk_model with_input(enum mk_input input) const
    {
        mk_model m = model;
        m.input = input;
        return m;
    }
    // The first rows of every log, the same for either column.
    std::vector<FitLog> fit_logs(const std::vector<mk_record> &records, const mk_model &m) const
    {
        std::vector<FitLog> all;
        double hole = 0.0;
        for (size_t i = 0; i < records.size(); i++) {
            const size_t rows = std::min(records[i].rows, MOST_ROWS / records.size());
            for (const Piece &piece : pieces_of(records[i], rows, hole))
                all.push_back(fit_log(records[i], m, piece.first, piece.last, (int)i));
        }
        return all;
    }
    static std::vector<const FitLog *> without(const std::vector<FitLog> &all, size_t fold,
                                               size_t folds)
    {
        std::vector<const FitLog *> view;
        for (const FitLog &log : all)
            if (fold >= folds || (size_t)log.source % folds != fold)
                view.push_back(&log);
        return view;
    }
    FitOptions fit_options(const Column &column) const
    {
        FitOptions o;
        o.threads = options.threads;
        o.near = &column.start;
        o.max_passes = MOST_PASSES;
        return o;
    }
    // Where fits begin, which for a given model that is orders of magnitude off is elsewhere.
    mk_model first_model(const mk_model &m, const std::vector<mk_record> &records,
                         const std::vector<const FitLog *> &view) const
    {
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
        std::vector<mk_record> records(logs.size());
        for (size_t i = 0; i < logs.size(); i++) {
            enum mk_status st = mk_record_from_log(logs[i], &m, &records[i], err);
            if (st != MK_OK)
                return st;
        }
        out.logs = fit_logs(records, m);
        const std::vector<const FitLog *> view = without(out.logs, 1, 1);
        out.start = m;
        if (like)
            std::copy_n(like->start.parameter, MK_MAX_PARAMETERS, out.start.parameter);
        else
            out.start = first_model(m, records, view);
        for (int number : fitted_parameters(m))
            if (!options.fixed[number])
                out.free.push_back(number);
        Fit fit(view, fit_options(out));
        fit.progress = options.progress;
        fit.progress_context = options.progress_context;
        out.point = fit.start(out.start);
        const bool fitted = fit.descend(out.point, out.free, LOOSEST, TIGHTEST, out.picture);
        out.drift = fit.options.drift[0];
        if (fit.cancelled)
            return mk_error_set(err, MK_ERR_INTR, "stopped");
        return fitted ? MK_OK
                      : mk_error_set(err, MK_ERR_NUMERIC,
                                     "the model cannot follow the data with the %s column",
                                     mk_input_name(m.input));
    }
    // Late, and with a lag as well where that predicts logs left out surely better.
    enum mk_status fit_commanded(const Column &measured, std::unique_ptr<Column> &out,
                                 mk_error *err) const
    {
        mk_model late = with_input(MK_INPUT_COMMANDED);
        add(late, "input-delay", mk_effect_by_name("input-delay")->parameter[0].initial);
        enum mk_status st = fit(late, &measured, *out, err);
        if (st == MK_OK)
            st = leave_out(*out, err);
        if (st != MK_OK || place_of(model, "actuator-lag") >= 0 || !gains_by_a_lag(*out))
            return st;
        auto slow = std::make_unique<Column>();
        mk_model lagging = late;
        add(lagging, "actuator-lag", FIRST_LAG);
        st = fit(lagging, &measured, *slow, err);
        const bool lags = st == MK_OK && slow->is_late("actuator-lag") &&
                          slow->value("actuator-lag") > LEAST_LAG * slow->logs[0].period &&
                          slow->picture.evidence < out->picture.evidence - ENOUGH;
        if (lags)
            st = leave_out(*slow, err);
        if (lags && st == MK_OK && predicts_better(*slow, *out))
            out = std::move(slow);
        return st == MK_ERR_NUMERIC ? MK_OK : st;
    }
    // Whether a lag gains enough beside the delay, from where the fit without one is.
    bool gains_by_a_lag(const Column &late) const
    {
        const std::vector<const FitLog *> view = without(late.logs, 1, 1);
        mk_model lagging = late.point.model;
        add(lagging, "actuator-lag", FIRST_LAG);
        std::vector<int> free = late.free;
        free.push_back(number_of(lagging, "actuator-lag"));
        std::sort(free.begin(), free.end());
        Fit fit(view, fit_options(late));
        FitPoint point = fit.adopt(late.point, lagging);
        FitPicture picture;
        return fit.settle(point, free, late.drift, picture) &&
               picture.evidence < late.picture.evidence - ENOUGH;
    }
    // Fits without a part of the logs start from that of all.
    enum mk_status leave_out(Column &column, mk_error *err) const
    {
        const size_t folds = std::min(logs.size(), MOST_FOLDS);
        std::vector<mk_model> found(folds);
        std::vector<char> fitted(folds, false);
        parallel_for(options.threads, folds, [&](size_t fold) {
            FitOptions o = fit_options(column);
            o.threads = 1;
            Fit fit(without(column.logs, fold, folds), o);
            FitPoint point = column.point;
            point.nodes.clear();
            for (size_t l = 0; l < column.logs.size(); l++)
                if ((size_t)column.logs[l].source % folds != fold)
                    point.nodes.push_back(column.point.nodes[l]);
            FitPicture picture;
            fitted[fold] = fit.settle(point, column.free, column.drift, picture);
            found[fold] = point.model;
        });
        if (!std::all_of(fitted.begin(), fitted.end(), [](char yes) { return yes; }))
            return mk_error_set(err, MK_ERR_NUMERIC,
                                "the model cannot follow a part of the data with the %s column",
                                mk_input_name(column.start.input));
        const HeldOut held(logs, WINDOW_S, mk_model_has_own_values(&model));
        std::vector<HeldOutFigures> by_log(logs.size());
        std::vector<enum mk_status> status(logs.size());
        parallel_for(options.threads, logs.size(), [&](size_t i) {
            status[i] = held.add_log(found[i % folds], i, by_log[i], nullptr);
        });
        for (size_t i = 0; i < logs.size(); i++) {
            if (status[i] != MK_OK)
                return mk_error_at(err, status[i], logs[i]->path, 0, 0,
                                   "no free run over this log with the %s column",
                                   mk_input_name(column.start.input));
            column.left_out.append(by_log[i]);
        }
        return MK_OK;
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

// Time-aligned mean and covariance of repeated runs.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <new>
#include <vector>

#include "mechkit/signals.h"

namespace
{

constexpr double NONE = std::numeric_limits<double>::quiet_NaN();
constexpr double LONGEST_SHIFT_S = 1.0;
constexpr size_t COMPARED = 4000; // rows that alignment looks at

struct FreeRepeats {
    void operator()(mk_repeats *r) const { mk_repeats_free(r); }
};

// A run's signals on even rows of a common period.
struct Run {
    std::vector<double> signal[MK_MAX_SIGNALS];
    size_t rows = 0;
    long shift = 0; // row k of the first run is row k + shift of this one

    double at(int s, long k) const
    {
        return k >= 0 && k < (long)rows ? signal[s][(size_t)k] : NONE;
    }
};

double period_of(const mk_record &r)
{
    std::vector<double> d;
    for (size_t k = 0; k + 1 < r.rows; k++)
        d.push_back(r.t[k + 1] - r.t[k]);
    if (d.empty())
        return 0.0;
    std::nth_element(d.begin(), d.begin() + (long)(d.size() / 2), d.end());
    return d[d.size() / 2];
}

Run run_of(const mk_record &r, double period, int joints, int inputs)
{
    Run run;
    double span = (r.t[r.rows - 1] - r.t[0]) / period;
    run.rows = std::min((size_t)std::lround(span) + 1, 4 * r.rows);
    for (int s = 0; s < joints + inputs; s++) {
        const double *x = s < joints ? r.q[s] : r.u[s - joints];
        run.signal[s].assign(run.rows, NONE);
        for (size_t k = 0; k < r.rows; k++) {
            double place = (r.t[k] - r.t[0]) / period, row = std::round(place);
            if (row < (double)run.rows && std::fabs(place - row) < 0.25)
                run.signal[s][(size_t)row] = x[k];
        }
    }
    return run;
}

double rms_about_mean(const std::vector<double> &x)
{
    double sum = 0.0, square = 0.0, n = 0.0;
    for (double v : x)
        if (!std::isnan(v))
            sum += v, square += v * v, n += 1.0;
    return n > 0.0 ? std::sqrt(std::max(square / n - sum / n * (sum / n), 0.0)) : 0.0;
}

// Mean square of the differences of all signals, each in units of its own scale.
double distance(const Run &a, const Run &b, int signals, const double *scale, long shift)
{
    size_t stride = std::max<size_t>(1, a.rows / COMPARED);
    double sum = 0.0, n = 0.0;
    for (int s = 0; s < signals; s++) {
        if (!(scale[s] > 0.0))
            continue;
        for (size_t k = 0; k < a.rows; k += stride) {
            double d = (b.at(s, (long)k + shift) - a.signal[s][k]) / scale[s];
            if (!std::isnan(d))
                sum += d * d, n += 1.0;
        }
    }
    return n > 0.0 ? sum / n : HUGE_VAL;
}

void align(const Run &first, Run &run, int signals, double period)
{
    double scale[MK_MAX_SIGNALS], best = HUGE_VAL;
    for (int s = 0; s < signals; s++)
        scale[s] = rms_about_mean(first.signal[s]);
    long most = std::min((long)(LONGEST_SHIFT_S / period), (long)first.rows / 4);
    for (long i = 0; i <= 2 * most; i++) {
        long shift = i % 2 ? (i + 1) / 2 : -i / 2; // 0, 1, -1, 2, ..: the least of equals wins
        double d = distance(first, run, signals, scale, shift);
        if (d < best)
            best = d, run.shift = shift;
    }
}

enum mk_status make_mean(const mk_record &first, double period, size_t rows, int joints,
                         mk_repeats &out, double **column)
{
    const char *two[] = {first.si ? "tau1" : "u1", first.si ? "tau2" : "u2"};
    const char *one = first.si ? "tau" : "u";
    if (mk_log_create(rows, &out.mean) != MK_OK)
        return MK_ERR_NOMEM;
    double *t = mk_log_add_column(out.mean, "t");
    for (int s = 0; s < out.signals; s++) {
        const char *name = s < joints                  ? mk_log_angle(s)
                           : out.signals == joints + 1 ? one
                                                       : two[s - joints];
        column[s] = mk_log_add_column(out.mean, name);
        if (!column[s])
            return MK_ERR_NOMEM;
    }
    if (!t)
        return MK_ERR_NOMEM;
    for (size_t k = 0; k < rows; k++)
        t[k] = first.t[0] + period * (double)k;
    return MK_OK;
}

// Mean of one row, each signal over the runs that have it; covariance over those that have all.
void average_row(const std::vector<Run> &runs, size_t k, int signals, double **mean, double *cov)
{
    std::vector<const Run *> whole;
    for (int s = 0; s < signals; s++) {
        double sum = 0.0, n = 0.0;
        for (const Run &run : runs) {
            double x = run.at(s, (long)k + run.shift);
            if (!std::isnan(x))
                sum += x, n += 1.0;
        }
        mean[s][k] = n > 0.0 ? sum / n : NONE;
    }
    for (const Run &run : runs) {
        bool all = true;
        for (int s = 0; s < signals; s++)
            all = all && !std::isnan(run.at(s, (long)k + run.shift));
        if (all)
            whole.push_back(&run);
    }
    double n = (double)whole.size();
    for (int a = 0; a < signals; a++)
        for (int b = 0; b < signals; b++) {
            double sum = 0.0, of_a = 0.0, of_b = 0.0;
            for (const Run *run : whole) {
                double x = run->at(a, (long)k + run->shift) - mean[a][k];
                double y = run->at(b, (long)k + run->shift) - mean[b][k];
                sum += x * y, of_a += x, of_b += y;
            }
            cov[a * signals + b] = n > 1.0 ? (sum - of_a * of_b / n) / (n - 1.0) : NONE;
        }
}

void pool(mk_repeats &out, size_t rows)
{
    int cells = out.signals * out.signals;
    double n = 0.0;
    for (size_t k = 0; k < rows; k++) {
        const double *cov = out.covariance + k * (size_t)cells;
        if (std::isnan(cov[0]))
            continue;
        for (int i = 0; i < cells; i++)
            out.pooled[i] += cov[i];
        n += 1.0;
    }
    for (int i = 0; i < cells; i++)
        out.pooled[i] = n > 0.0 ? out.pooled[i] / n : NONE;
}

enum mk_status read_records(const mk_model *model, const mk_log *const *logs, size_t count,
                            std::vector<mk_record> &records, mk_error *err)
{
    for (size_t i = 0; i < count; i++) {
        mk_record r;
        enum mk_status st = mk_record_from_log(logs[i], model, &r, err);
        if (st != MK_OK)
            return st;
        if (!r.u[0])
            return mk_error_at(err, MK_ERR_RANGE, logs[i]->path, 0, 0,
                               "a run without a command, by which repeated runs are found");
        double period = period_of(r), first = i ? period_of(records[0]) : period;
        if (!(period > 0.0) || std::fabs(period - first) > 0.01 * first)
            return mk_error_at(err, MK_ERR_RANGE, logs[i]->path, 0, 0,
                               "a run at another sample rate than the first");
        if (i && (r.u[1] == nullptr) != (records[0].u[1] == nullptr))
            return mk_error_at(err, MK_ERR_RANGE, logs[i]->path, 0, 0,
                               "a run with another number of commands than the first");
        records.push_back(r);
    }
    return MK_OK;
}

} // namespace

void mk_repeats_free(mk_repeats *r)
{
    if (!r)
        return;
    mk_log_free(r->mean);
    delete[] r->shift_s;
    delete[] r->covariance;
    delete r;
}

enum mk_status mk_average_runs(const mk_model *model, const mk_log *const *logs, size_t count,
                               mk_repeats **result, mk_error *err)
try {
    if (count < 2)
        return mk_error_set(err, MK_ERR_RANGE, "a mean of runs needs two at least");
    std::vector<mk_record> records;
    enum mk_status st = read_records(model, logs, count, records, err);
    if (st != MK_OK)
        return st;
    int joints = mk_model_joints(model), inputs = records[0].u[1] ? 2 : 1;
    double period = period_of(records[0]);
    std::unique_ptr<mk_repeats, FreeRepeats> out(new mk_repeats());
    out->runs = count;
    out->signals = joints + inputs;
    out->shift_s = new double[count]();
    std::vector<Run> runs;
    for (size_t i = 0; i < count; i++) {
        runs.push_back(run_of(records[i], period, joints, inputs));
        if (i > 0)
            align(runs[0], runs[i], out->signals, period);
        if (runs[i].rows < runs[0].rows / 2)
            return mk_error_at(err, MK_ERR_RANGE, logs[i]->path, 0, 0,
                               "a run less than half as long as the first");
        out->shift_s[i] = (double)runs[i].shift * period;
    }
    double *mean[MK_MAX_SIGNALS];
    size_t rows = runs[0].rows, cells = (size_t)(out->signals * out->signals);
    if (make_mean(records[0], period, rows, joints, *out, mean) != MK_OK)
        throw std::bad_alloc();
    out->covariance = new double[rows * cells];
    for (size_t k = 0; k < rows; k++)
        average_row(runs, k, out->signals, mean, out->covariance + k * cells);
    pool(*out, rows);
    for (int s = 0; s < out->signals; s++)
        out->rms[s] = rms_about_mean(std::vector<double>(mean[s], mean[s] + rows));
    *result = out.release();
    return MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory to average runs");
}

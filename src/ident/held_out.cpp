#include "ident/held_out.hpp"

#include "base/parallel.hpp"
#include "sim/predict.h"

namespace mk
{

void HeldOutFigures::append(const HeldOutFigures &other)
{
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        square[j] += other.square[j];
        rows[j] += other.rows[j];
        part[j].insert(part[j].end(), other.part[j].begin(), other.part[j].end());
    }
    window.insert(window.end(), other.window.begin(), other.window.end());
    log.insert(log.end(), other.log.begin(), other.log.end());
}

enum mk_status HeldOut::figures(const mk_model &m, HeldOutFigures &f, mk_error *err) const
{
    std::vector<HeldOutFigures> each(logs.size());
    std::vector<enum mk_status> status(logs.size(), MK_OK);
    std::vector<mk_error> error(logs.size());
    parallel_for(threads, logs.size(),
                 [&](size_t i) { status[i] = add_log(m, i, each[i], &error[i]); });
    for (size_t i = 0; i < logs.size(); i++) {
        if (status[i] != MK_OK) {
            if (err)
                *err = error[i];
            return status[i];
        }
        f.append(each[i]);
    }
    return MK_OK;
}

enum mk_status HeldOut::add_log(const mk_model &m, size_t number, HeldOutFigures &f,
                                mk_error *err) const
{
    mk_predict_options o = {};
    o.window_s = window_s;
    o.second_half = half;
    mk_predict_figures figures;
    mk_log *prediction = nullptr;
    enum mk_status st =
        mk_predict_angles(&m, logs[number], &o, &prediction, &figures, nullptr, err);
    if (st == MK_OK)
        add_windows(m, (int)number, *prediction, figures.from_s, f);
    mk_log_free(prediction);
    return st;
}

void HeldOut::add_windows(const mk_model &m, int number, const mk_log &prediction, double from_s,
                          HeldOutFigures &f) const
{
    const mk_log &log = *logs[(size_t)number];
    mk_record record;
    const double *window = mk_log_get(&prediction, "window");
    if (!window || mk_record_from_log(&log, &m, &record, nullptr) != MK_OK)
        return;
    // A run that goes off to infinity is no better than one that only goes far.
    constexpr double LOST = 3.0; // standard deviations
    const size_t first = f.window.size();
    for (int j = 0; j < mk_model_joints(&m); j++) {
        const double *q = mk_log_get(&prediction, mk_log_angle(j));
        const double sd = deviation(m, j);
        // Of errors below the rounding of the readings, as at rest, none is better than another.
        const double rounding = sd > 0.0 ? mk_model_count(&m, j) / std::sqrt(12.0) / sd : 0.0;
        for (size_t k = 0; q && sd > 0.0 && k < record.rows; k++) {
            if (std::isnan(window[k])) // left out
                continue;
            const size_t place = first + (size_t)window[k];
            if (place >= f.window.size()) {
                for (auto *v : {&f.window, &f.part[0], &f.part[1]})
                    v->resize(place + 1, 0.0);
                f.log.resize(place + 1, number);
            }
            if (std::isnan(record.q[j][k]) || record.t[k] - record.t[0] < from_s)
                continue;
            const double off = std::isfinite(q[k]) ? (q[k] - record.q[j][k]) / sd : LOST;
            f.window[place] += std::max(off * off, rounding * rounding);
            f.part[j][place] += off * off;
            f.square[j] += off * off;
            f.rows[j] += 1.0;
        }
    }
}

bool clearly_worse(const HeldOutFigures &a, const HeldOutFigures &b)
{
    double sum = 0.0, squares = 0.0, n = 0.0;
    for (size_t i = 0; i < std::min(a.window.size(), b.window.size()); i++) {
        if (!(a.window[i] > 0.0) || !(b.window[i] > 0.0))
            continue;
        double ratio = std::log(a.window[i] / b.window[i]);
        sum += ratio, squares += ratio * ratio, n += 1.0;
    }
    if (n < 2.0)
        return a.total() > b.total();
    double mean = sum / n, error = std::sqrt(std::max(squares / n - mean * mean, 0.0) / n);
    return mean > std::max(2.0 * error, std::log(1.02));
}

LogRatio ratio_by_log(const HeldOutFigures &a, const HeldOutFigures &b)
{
    LogRatio r;
    double sum = 0.0, squares = 0.0, all = 0.0, all_squares = 0.0, n = 0.0;
    const size_t count = std::min(a.window.size(), b.window.size());
    for (size_t first = 0, i = 0; i <= count; i++) {
        if (i < count && a.log[i] == a.log[first])
            continue;
        double of_log = 0.0, windows = 0.0;
        for (; first < i; first++)
            if (a.window[first] > 0.0 && b.window[first] > 0.0) {
                const double ratio = std::log(a.window[first] / b.window[first]);
                of_log += ratio, windows += 1.0;
                all += ratio, all_squares += ratio * ratio, n += 1.0;
            }
        if (!(windows > 0.0))
            continue;
        of_log /= windows;
        sum += of_log, squares += of_log * of_log;
        r.logs++;
        r.better += of_log < 0.0;
    }
    if (r.logs == 0)
        return r;
    r.mean = sum / r.logs;
    if (n > 1.0)
        r.window_error =
            std::sqrt(std::max(all_squares / n - all / n * (all / n), 0.0) / (n - 1.0));
    if (r.logs > 1)
        r.error = std::sqrt(std::max(squares / r.logs - r.mean * r.mean, 0.0) / (r.logs - 1));
    return r;
}

bool surely_better(const LogRatio &r)
{
    constexpr double LESS = 0.05; // of the squared error must go, at least
    constexpr double SURE = 2.0;  // standard errors
    const bool majority = 2 * r.better > r.logs;
    const bool sure = r.logs > 2 ? r.better == r.logs || r.mean < -SURE * r.error
                                 : r.better == r.logs && r.mean < -SURE * r.window_error;
    return majority && sure && r.mean < std::log(1.0 - LESS);
}

double HeldOut::deviation(const mk_model &model, int joint) const
{
    double sum = 0.0, squares = 0.0, n = 0.0;
    for (const mk_log *log : logs) {
        mk_record record;
        if (mk_record_from_log(log, &model, &record, nullptr) != MK_OK)
            continue;
        for (size_t k = 0; k < record.rows; k++) {
            double q = record.q[joint][k];
            if (std::isnan(q))
                continue;
            sum += q, squares += q * q, n += 1.0;
        }
    }
    return n > 1.0 ? std::sqrt(std::max(squares / n - sum / n * (sum / n), 0.0)) : 0.0;
}

double HeldOut::largest_command(const mk_model &model) const
{
    double most = 0.0;
    for (const mk_log *log : logs) {
        mk_record record;
        if (mk_record_from_log(log, &model, &record, nullptr) != MK_OK || !record.u[0])
            continue;
        for (size_t k = 0; k < record.rows; k++)
            if (!record.left_out || record.left_out[k] == 0.0)
                most = std::fmax(most, std::fabs(record.u[0][k])); // not a NaN
    }
    return most;
}

} // namespace mk

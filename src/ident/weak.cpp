#include "ident/weak.hpp"

#include <algorithm>
#include <cmath>

namespace mk
{

size_t WeakWindow::half(const Track &track) const
{
    size_t wanted = (size_t)std::lround(0.5 * seconds / track.period);
    return std::max<size_t>(1, std::min(wanted, track.rows() / 8));
}

size_t WeakWindow::hop(const Track &track) const
{
    return std::max<size_t>(1, (size_t)(2.0 * (double)half(track) / per_window));
}

namespace
{

// Samples of the equations around the window that is being summed: each is evaluated once.
class SampleRing
{
  public:
    SampleRing(const WeakForm &f, const mk_model &m, const Track &t, size_t reach)
        : form(f), model(m), track(t), ring(2 * reach + 1), next(0)
    {
    }
    // Rows up to `last` are there; called with growing rows, none more than the ring's size behind.
    void advance(size_t first, size_t last)
    {
        for (next = std::max(next, first); next <= last; next++) {
            WeakSample &s = ring[next % ring.size()];
            s = WeakSample();
            form.sample(model, track, next, s);
        }
    }
    const WeakSample &operator[](size_t row) const { return ring[row % ring.size()]; }

  private:
    const WeakForm &form;
    const mk_model &model;
    const Track &track;
    std::vector<WeakSample> ring;
    size_t next;
};

// A raised cosine of unit sum: zero with its slope at both ends. With its central differences, one
// sample wider, both padded with zeros to the reach.
struct Window {
    std::vector<double> w, slope;

    Window(size_t half, double period) : w(2 * half + 5, 0.0), slope(w.size(), 0.0)
    {
        double sum = 0.0, n = (double)(half + 1);
        for (size_t i = 0; i < 2 * half + 1; i++)
            sum += w[i + 2] = 0.5 + 0.5 * std::cos(M_PI * ((double)i - (double)half) / n);
        for (double &x : w)
            x /= sum;
        for (size_t i = 1; i + 1 < w.size(); i++)
            slope[i] = (w[i + 1] - w[i - 1]) / (2.0 * period);
    }
};

// angle - (speed)' + (acceleration)'', the samples of which are zero at and beyond both ends.
void by_parts(const std::vector<double> &angle, const std::vector<double> &speed,
              const std::vector<double> &acceleration, double period, std::vector<double> &out)
{
    size_t n = angle.size();
    auto at = [&](const std::vector<double> &x, size_t i) { return i < n ? x[i] : 0.0; };
    out.resize(n);
    for (size_t i = 0; i < n; i++) {
        double before = i > 0 ? speed[i - 1] : 0.0, bend = i > 0 ? acceleration[i - 1] : 0.0;
        out[i] = angle[i] - (at(speed, i + 1) - before) / (2.0 * period) +
                 (at(acceleration, i + 1) - 2.0 * acceleration[i] + bend) / (period * period);
    }
}

struct Summer {
    const WeakForm &form;
    const Track &track;
    const Window window;
    int parameters;
    std::vector<double> angle, speed, acceleration;

    Summer(const WeakForm &f, const mk_model &model, const Track &t, size_t half)
        : form(f), track(t), window(half, t.period),
          parameters(mk_plant(model.plant)->parameter_count), angle(window.w.size()), speed(angle),
          acceleration(angle)
    {
    }

    void sum(const SampleRing &samples, size_t first, WeakRow &row)
    {
        for (int e = 0; e < form.equations; e++) {
            std::fill_n(row.x[e], parameters, 0.0);
            row.y[e] = 0.0;
            for (size_t i = 0; i < window.w.size(); i++) {
                const WeakSample &s = samples[first + i];
                double w = window.w[i], slope = e == 0 ? window.slope[i] : 0.0;
                for (int p = 0; p < parameters; p++)
                    row.x[e][p] += w * s.flow[e][p] - slope * s.stock[p];
                row.y[e] += w * s.source[e];
            }
            for (int j = 0; j < track.joints; j++)
                weigh_noise(samples, first, e, j, row);
        }
    }

    void weigh_noise(const SampleRing &samples, size_t first, int e, int j, WeakRow &row)
    {
        double sigma = track.noise[j];
        for (size_t i = 0; i < window.w.size(); i++) {
            const WeakSample &s = samples[first + i];
            double w = sigma * window.w[i], slope = e == 0 ? sigma * window.slope[i] : 0.0;
            angle[i] = w * s.flow_q[e][j] - slope * s.stock_q[j];
            speed[i] = w * s.flow_v[e][j] - slope * s.stock_v[j];
            acceleration[i] = w * s.flow_a[e][j];
        }
        row.angle_noise[e][j] = angle;
        by_parts(angle, speed, acceleration, track.period, row.noise[e][j]);
    }
};

// A tenth of a second at either end is left to the smoother, at most a tenth of the log.
size_t margin(const Track &track)
{
    return std::max<size_t>(1, std::min((size_t)(0.1 / track.period), track.rows() / 10));
}

void each_row_of(const WeakForm &form, const mk_model &model, const Track &track,
                 const WeakWindow &window, const std::function<void(const WeakRow &)> &visit)
{
    size_t reach = window.reach(track), hop = window.hop(track), first = margin(track);
    SampleRing samples(form, model, track, reach);
    Summer summer(form, model, track, window.half(track));
    WeakRow row;
    size_t unmeasured = first; // rows from here on are known to be measured up to `seen`
    size_t seen = first;
    row.starts_log = true;
    for (; first + 2 * reach + margin(track) < track.rows(); first += hop) {
        for (; seen <= first + 2 * reach; seen++)
            unmeasured = track.measured[seen] ? unmeasured : seen + 1;
        if (unmeasured > first)
            continue;
        samples.advance(first, first + 2 * reach);
        summer.sum(samples, first, row);
        row.centre = first + reach;
        visit(row);
        row.starts_log = false;
    }
}

} // namespace

void each_weak_row(const WeakForm &form, const mk_model &model, const std::vector<Track> &tracks,
                   const WeakWindow &window, const std::function<void(const WeakRow &)> &visit)
{
    for (const Track &track : tracks)
        each_row_of(form, model, track, window, visit);
}

} // namespace mk

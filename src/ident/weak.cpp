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
// sample wider, both padded with zeros to the reach. Of one that the log's start cuts, `cut`
// samples are missing; the first that is there counts half, and the stock at it with the whole
// step.
struct Window {
    std::vector<double> w, slope;
    size_t cut;

    Window(size_t half, double period, size_t missing)
        : w(2 * half + 5, 0.0), slope(w.size(), 0.0), cut(missing)
    {
        double sum = 0.0, n = (double)(half + 1);
        for (size_t i = 0; i < 2 * half + 1; i++)
            sum += w[i + 2] = 0.5 + 0.5 * std::cos(M_PI * ((double)i - (double)half) / n);
        for (double &x : w)
            x /= sum;
        for (size_t i = cut + 1; i + 1 < w.size(); i++)
            slope[i] = (w[i + 1] - w[i - 1]) / (2.0 * period);
        if (cut > 0) {
            slope[cut] = (w[cut + 1] + w[cut]) / (2.0 * period);
            w[cut] *= 0.5;
        }
        std::fill_n(w.begin(), cut, 0.0);
    }
};

// angle - (speed)' + (acceleration)'', the samples of which are zero at and beyond both ends. At a
// log's start speed is the difference of the first two readings.
void by_parts(const std::vector<double> &angle, const std::vector<double> &speed,
              const std::vector<double> &acceleration, double period, size_t cut,
              std::vector<double> &out)
{
    size_t n = angle.size();
    auto at = [&](const std::vector<double> &x, size_t i) { return i < n ? x[i] : 0.0; };
    out.assign(n, 0.0);
    for (size_t i = cut; i < n; i++) {
        double before = i > 0 ? speed[i - 1] : 0.0, bend = i > 0 ? acceleration[i - 1] : 0.0;
        out[i] = angle[i] - (at(speed, i + 1) - before) / (2.0 * period) +
                 (at(acceleration, i + 1) - 2.0 * acceleration[i] + bend) / (period * period);
    }
    if (cut > 0) {
        out[cut] -= speed[cut] / period;
        out[cut + 1] += 0.5 * speed[cut] / period;
    }
}

struct Summer {
    const WeakForm &form;
    const Track &track;
    int parameters;
    std::vector<double> angle, speed, acceleration;

    Summer(const WeakForm &f, const mk_model &model, const Track &t, size_t reach)
        : form(f), track(t), parameters(mk_plant(model.plant)->parameter_count),
          angle(2 * reach + 1), speed(angle), acceleration(angle)
    {
    }

    // The window's sample `cut` is row `first` of the track.
    void sum(const Window &window, const SampleRing &samples, size_t first, WeakRow &row)
    {
        for (int e = 0; e < form.equations; e++) {
            std::fill_n(row.x[e], parameters, 0.0);
            row.y[e] = 0.0;
            for (size_t i = window.cut; i < window.w.size(); i++) {
                const WeakSample &s = samples[first + i - window.cut];
                double w = window.w[i], slope = e == 0 ? window.slope[i] : 0.0;
                for (int p = 0; p < parameters; p++)
                    row.x[e][p] += w * s.flow[e][p] - slope * s.stock[p];
                row.y[e] += w * s.source[e];
            }
            for (int j = 0; j < track.joints; j++)
                weigh_noise(window, samples, first, e, j, row);
        }
    }

    void weigh_noise(const Window &window, const SampleRing &samples, size_t first, int e, int j,
                     WeakRow &row)
    {
        double sigma = track.noise[j];
        for (std::vector<double> *x : {&angle, &speed, &acceleration})
            std::fill_n(x->begin(), window.cut, 0.0);
        for (size_t i = window.cut; i < window.w.size(); i++) {
            const WeakSample &s = samples[first + i - window.cut];
            double w = sigma * window.w[i], slope = e == 0 ? sigma * window.slope[i] : 0.0;
            angle[i] = w * s.flow_q[e][j] - slope * s.stock_q[j];
            speed[i] = w * s.flow_v[e][j] - slope * s.stock_v[j];
            acceleration[i] = w * s.flow_a[e][j];
        }
        row.angle_noise[e][j] = angle;
        by_parts(angle, speed, acceleration, track.period, window.cut, row.noise[e][j]);
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
    size_t reach = window.reach(track), half = window.half(track), hop = window.hop(track);
    SampleRing samples(form, model, track, reach);
    Summer summer(form, model, track, reach);
    const Window whole(half, track.period, 0);
    WeakRow row;
    row.starts_log = true;
    row.centre = form.balance ? 0 : margin(track) + reach;
    size_t seen = row.centre - std::min(row.centre, reach);
    size_t unmeasured = seen; // rows from here on are known to be measured up to `seen`
    for (; row.centre + reach + margin(track) < track.rows(); row.centre += hop) {
        size_t first = row.centre - std::min(row.centre, reach);
        for (; seen <= row.centre + reach; seen++)
            unmeasured = track.measured[seen] ? unmeasured : seen + 1;
        if (unmeasured > first)
            continue;
        samples.advance(first, row.centre + reach);
        if (row.centre < reach)
            summer.sum(Window(half, track.period, reach - row.centre), samples, first, row);
        else
            summer.sum(whole, samples, first, row);
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

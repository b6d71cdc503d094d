// The shooting kernel's readings: which of them a step comes past, what the model reads there, the
// residuals and their derivatives. A part of shoot_kernel.cc, which alone includes it.
#ifndef MECHKIT_SIM_SHOOT_READINGS_HPP
#define MECHKIT_SIM_SHOOT_READINGS_HPP

namespace mk
{
inline namespace MK_KERNEL_NS
{

template <class Law>
inline typename Shooter<Law>::Readings Shooter<Law>::readings(int j, const Base &end, double slack)
{
    Readings r;
    r.t = now;
    r.any = false;
    for (int i = 0; i < W; i++) {
        Lane &l = lane[i];
        r.row[i] = -1;
        if (!l.task || !pending(l, j, get(end, i) + slack))
            continue;
        r.row[i] = l.next[j]++;
        put(r.t, i, time_of(l, j, r.row[i]));
        r.any = true;
    }
    return r;
}

// A reading at t of a sensor that is late shows the state at t - age.
template <class Law>
inline double Shooter<Law>::time_of(const Lane &l, int j, long row) const
{
    return l.task->data->t[row] - age[j];
}

template <class Law>
inline bool Shooter<Law>::pending(const Lane &l, int j, double end) const
{
    const size_t rows = l.task->end_row ? l.task->end_row : l.task->data->rows;
    return l.next[j] < (long)rows && time_of(l, j, l.next[j]) < end;
}

template <class Law>
inline bool Shooter<Law>::readings_before(const Base &end) const
{
    for (int i = 0; i < W; i++)
        for (int j = 0; j < c.joints && lane[i].task; j++)
            if (pending(lane[i], j, get(end, i) - 1e-9))
                return true;
    return false;
}

// Readings that fall on the start of a step need no interpolation. Times are compared to within
// 1e-9 s.
template <class Law>
inline void Shooter<Law>::take_at_start()
{
    for (int j = 0; j < c.joints; j++)
        for (Readings r; (r = readings(j, now, 1e-9)).any;)
            compare_before(j, r);
}

// A reading of a late sensor whose state lies before the begin, by dt <= 0. Angles q and speeds
// v are those of the begin, extrapolated with its accelerations a, other states with their
// slopes:
//     q(dt) = q + dt v + dt^2 a / 2 ,   v(dt) = v + dt a ,
// and so are their derivatives.
template <class Law>
inline void Shooter<Law>::compare_before(int j, const Readings &r)
{
    const Base dt = r.t - now, half = 0.5 * dt * dt;
    bool any = false;
    for (int i = 0; i < W; i++)
        any = any || get(dt, i) < -1e-9;
    if (!any) {
        compare(j, r, x, f0.v);
        return;
    }
    Base rate[MK_MAX_STATES];
    if (!exact())
        derivative(now, x, f0);
    for (int i = 0; i < ns; i++) {
        const bool angle = i < c.joints;
        const int a = c.joints + i; // of the acceleration that goes with an angle
        rate[i] = angle ? f0.v[i] + dt * f0.v[a] : f0.v[i];
        y.v[i] = x.v[i] + dt * f0.v[i] + (angle ? half * f0.v[a] : Base(0.0));
        for (int d = 0; d < columns; d++)
            y.d[i * columns + d] = x.d[i * columns + d] + dt * f0.d[i * columns + d] +
                                   (angle ? half * f0.d[a * columns + d] : Base(0.0));
    }
    compare(j, r, y, rate);
}

template <class Law>
inline void Shooter<Law>::take_readings(const Base &end)
{
    for (int j = 0; j < c.joints; j++)
        for (Readings r; (r = readings(j, end, -1e-9)).any;)
            compare_within(j, r, end);
}

// Of lanes that have arrived.
template <class Law>
inline void Shooter<Law>::take_up_to_end(int j)
{
    Base end = Base(-NONE);
    for (int i = 0; i < W; i++)
        if (arrived(lane[i]) && lane[i].task->last && lane[i].task->finite)
            put(end, i, lane[i].task->end);
    for (Readings r; (r = readings(j, end, 1e-9)).any;)
        compare(j, r, x, f0.v);
}

template <class Law>
inline void Shooter<Law>::compare(int j, const Readings &r, const Point &at, const Base *rate)
{
    compare_rows(j, r, at.v, rate, [&](int i) { return at.d + i * columns; });
}

// A reading between both ends of a step: cubic Hermite interpolation. With s = (t - now)/h,
//     x(t) = h00 x + h10 f0 + h01 y + h11 f1 ,
//     h00 = (1 + 2 s)(1 - s)^2 ,   h10 = h s (1 - s)^2 ,
//     h01 = s^2 (3 - 2 s) ,        h11 = -h s^2 (1 - s) ,
// and g00 .. g11 are their derivatives by t, for the slope of the state (g01 = -g00). Its error
// is of fourth order, as that of the method. A reading depends on few of the states: no others
// have their derivatives interpolated. An idle lane has h = 0; 1 is put in its place.
template <class Law>
inline void Shooter<Law>::compare_within(int j, const Readings &r, const Base &end)
{
    Base h = end - now, inverse = 1.0 / if_positive(h, h, Base(1.0));
    Base s = (r.t - now) * inverse, left = 1.0 - s;
    Base h00 = (1.0 + 2.0 * s) * left * left, h10 = h * s * left * left,
         h01 = s * s * (3.0 - 2.0 * s), h11 = -h * s * s * left;
    Base g00 = -6.0 * s * left * inverse, g10 = left * (1.0 - 3.0 * s), g11 = s * (3.0 * s - 2.0);
    Base rate[MK_MAX_STATES];
    for (int i = 0; i < ns; i++) {
        between.v[i] = h00 * x.v[i] + h10 * f0.v[i] + h01 * y.v[i] + h11 * f1.v[i];
        rate[i] = g00 * x.v[i] + g10 * f0.v[i] - g00 * y.v[i] + g11 * f1.v[i];
    }
    compare_rows(j, r, between.v, rate, [&](int i) {
        if (!exact()) {
            slope_row(i, x, f0);
            slope_row(i, y, f1);
        }
        for (int d = i * columns; d < (i + 1) * columns; d++)
            between.d[d] = h00 * x.d[d] + h10 * f0.d[d] + h01 * y.d[d] + h11 * f1.d[d];
        return between.d + i * columns;
    });
}

// Readings beside what the model reads in a state, whose derivatives are row_of(its number).
// Residuals and their rows of J: with h_j what the model reads at joint j,
//     r = w (y - h_j) ,   J = w dh_j/dc .
// Readings without weight (missing ones) give no row. row_of(s) gives dx_s/dc.
template <class Law>
template <class RowOf>
inline void Shooter<Law>::compare_rows(int j, const Readings &r, const Base *at, const Base *rate,
                                       RowOf &&row_of)
{
    Scalar reading[MK_MAX_JOINTS];
    Row row;
    look_at(at);
    measure(c, in_log(r.t), seen, reading);
    chain_rows(
        reading[j], [&](int i) { return ages_move ? aged(i, j, row_of(i), rate) : row_of(i); },
        row.d);
    for (int i = 0; i < W; i++) {
        if (r.row[i] < 0)
            continue;
        Lane &l = lane[i];
        ShootTask &task = *l.task;
        // A weight of 0 is a missing reading.
        double w = task.data->w[j][r.row[i]];
        if (!(w > 0.0) || l.rows >= task.row_capacity)
            continue;
        task.residual[l.rows] = w * (task.data->q[j][r.row[i]] - get(base_of(reading[j]), i));
        store(row.d, i, w, task.jac + (long)l.rows * task.columns);
        if (task.joint_of)
            task.joint_of[l.rows] = j;
        l.rows++;
    }
}

// dx_s/dc at the time t - age, if the age is fitted: later readings would show the state as it
// was before, so d x_s(t - age)/dc = X_sc - f_s d(age)/dc.
template <class Law>
inline const Base *Shooter<Law>::aged(int i, int j, const Base *young, const Base *rate)
{
    for (int d = 0; d < columns; d++)
        older.d[i * columns + d] = young[d] - age_slope[j][d] * rate[i];
    return older.d + i * columns;
}

// Into a row of all columns: the states', then this pass's parameters. A kernel has room for
// MOST_COLUMNS columns; further parameters take another pass (first_free).
template <class Law>
inline void Shooter<Law>::store(const Base *d, int i, double w, double *row) const
{
    for (int s = 0; s < columns; s++)
        row[s < ns ? s : first + s] = w * get(d[s], i);
}

} // namespace MK_KERNEL_NS
} // namespace mk
#endif

// The shooting kernel of one instruction set (MK_ISA) and one number of derivative lanes (MK_LANES,
// 0: values alone). As in fast_kernel.cc nothing here may leak through the linker.
#include "model/dual.hpp"
#include "model/rhs.hpp"
#include "model/simd.hpp"
#include "sim/shoot.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

#if MK_LANES > 0
using Scalar = Dual<MK_LANES>;
inline void seed(Scalar &x, int lane, double slope)
{
    if (lane >= 0 && lane < MK_LANES)
        x.d[lane] = slope;
}
inline double slope_of(const Scalar &x, int lane)
{
    return x.d[lane];
}
#else
using Scalar = double;
inline void seed(Scalar &, int, double) {}
inline double slope_of(const Scalar &, int)
{
    return 0.0;
}
#endif

constexpr double NONE = 1e300;

template <class Law>
class Shooter
{
  public:
    Shooter(ShootTask &task, int first_column)
        : k(task), d(*task.data), c(compile<Scalar>(*task.model)), first(first_column)
    {
        seed_parameters();
        for (int i = 0; i < c.state_count; i++) {
            x[i] = Scalar(k.x[i]);
            seed(x[i], i - first, 1.0);
        }
    }

    void run()
    {
        find_start();
        double now = k.begin;
        k.finite = true;
        while (now < k.end && k.finite) {
            double edge = command + 1 < (long)d.rows ? d.t[command + 1] + value_of(delay) : NONE;
            double stop = edge < k.end ? edge : k.end;
            if (stop > now)
                advance(now, stop);
            now = stop;
            if (edge <= k.end && edge < NONE)
                turn_to(command + 1, now);
        }
        if (k.last && k.finite)
            read_up_to_end();
        for (int i = 0; i < c.state_count; i++) {
            k.x_end[i] = value_of(x[i]);
            store(x[i], k.jac_end + (long)i * k.columns);
        }
        k.row_count = rows;
    }

  private:
    ShootTask &k;
    const ShootData &d;
    Compiled<Scalar> c;
    int first;
    Scalar x[MK_MAX_STATES], f0[MK_MAX_STATES], f1[MK_MAX_STATES];
    Scalar u[MK_MAX_INPUTS];
    Scalar delay = Scalar(0.0);                             // of the command
    Scalar old[MK_MAX_JOINTS] = {Scalar(0.0), Scalar(0.0)}; // age of each joint's readings
    bool moving_edges = false;                              // the delay is differentiated by
    long command = -1;                                      // row in force
    long next[MK_MAX_JOINTS] = {0, 0};                      // first reading not yet taken
    long next_state = 0;
    size_t rows = 0;
    bool stiff = false;       // an effect has a rate
    bool slope_known = false; // f0 belongs to x

    void seed_parameters()
    {
        for (int f = 0; f < k.free_count; f++) {
            int lane = c.state_count + f - first, number = k.free[f];
            if (number < c.parameter_count) {
                seed(c.p[number], lane, k.scale[f]);
                continue;
            }
            number -= c.parameter_count;
            for (int e = 0; e < c.effect_count; e++) {
                int count = mk_effect(c.effect[e].index)->parameter_count;
                if (number >= 0 && number < count)
                    seed(c.effect[e].p[number], lane, k.scale[f]);
                number -= count;
            }
        }
        for (int e = 0; e < c.effect_count; e++) {
            stiff = stiff || effect_ops<Scalar>(c.effect[e].index).rate;
            unsigned stages = mk_effect(c.effect[e].index)->stages;
            if (stages & MK_STAGE_COMMAND_DELAY)
                delay += c.effect[e].p[0];
            if (stages & MK_STAGE_SENSOR_DELAY)
                for (int j = 0; j < c.joints; j++)
                    if (c.effect[e].joint < 0 || c.effect[e].joint == j)
                        old[j] += c.effect[e].p[0];
        }
        moving_edges = false;
        for (int i = 0; i < MK_LANES; i++)
            moving_edges = moving_edges || slope_of(delay, i) != 0.0;
    }

    // First row whose time, shifted by `by`, is not before the begin.
    long first_row(double by) const
    {
        long low = 0, high = (long)d.rows;
        while (low < high) {
            long mid = (low + high) / 2;
            if (d.t[mid] + by < k.begin - 1e-9)
                low = mid + 1;
            else
                high = mid;
        }
        return low;
    }
    void find_start()
    {
        long row = first_row(value_of(delay));
        bool on_edge = row < (long)d.rows && d.t[row] + value_of(delay) <= k.begin + 1e-9;
        set_command(on_edge ? row : row - 1);
        for (int j = 0; j < c.joints; j++)
            next[j] = first_row(-value_of(old[j]));
        next_state = first_row(0.0);
    }
    void set_command(long row)
    {
        command = row;
        // Before the first row the motor was off.
        u[0] = Scalar(row >= 0 ? d.u[0][row] : 0.0);
        u[1] = Scalar(row >= 0 && d.u[1] ? d.u[1][row] : 0.0);
    }
    void derivative(double t, const Scalar *at, Scalar *dx) const
    {
        rhs_of<Law>(c, Scalar(t), at, u, dx);
    }
    // The next command takes over. If the edge moves with the delay, so does what follows.
    void turn_to(long row, double t)
    {
        double before[MK_MAX_STATES];
        if (moving_edges) {
            derivative(t, x, f1);
            for (int i = 0; i < c.state_count; i++)
                before[i] = value_of(f1[i]);
        }
        set_command(row);
        slope_known = false;
        if (!moving_edges)
            return;
        derivative(t, x, f0);
        Scalar late = delay - value_of(delay);
        for (int i = 0; i < c.state_count; i++)
            x[i] += late * (before[i] - value_of(f0[i]));
    }

    // From `from` to `to` under one command, in equal steps.
    void advance(double from, double to)
    {
        double length = to - from;
        if (!slope_known)
            derivative(from, x, f0);
        slope_known = true;
        long count = (long)(length / k.step + 0.999);
        long sharp = reversal_steps(length);
        if (stiff) {
            double rate = fastest_rate(c, Scalar(from), x) * length / 1.6;
            count = rate > (double)count ? (long)(rate < 24.0 ? rate + 1.0 : 24.0) : count;
        }
        if (sharp > count)
            count = sharp;
        if (count < 1)
            count = 1;
        double h = length / (double)count;
        for (long i = 0; i < count && k.finite; i++)
            step(from + h * (double)i, i + 1 == count ? to : from + h * (double)(i + 1));
    }
    // Friction turns over within |v| < 0.2 rad/s; a step must resolve that.
    long reversal_steps(double length) const
    {
        long count = 1;
        for (int j = 0; j < c.joints; j++) {
            double v = fabs(value_of(x[c.joints + j])),
                   dv = fabs(value_of(f0[c.joints + j])) * length;
            long need = v < 0.2 + dv ? (long)(dv / 0.05) + 1 : 1;
            if (need > count)
                count = need < 8 ? need : 8;
        }
        return count;
    }

    // One step of the classical Runge-Kutta method; f0 is the slope at its start.
    void step(double a, double b)
    {
        double h = b - a, mid = a + 0.5 * h;
        int ns = c.state_count;
        Scalar k2[MK_MAX_STATES], k3[MK_MAX_STATES], k4[MK_MAX_STATES], y[MK_MAX_STATES];
        if (!slope_known)
            derivative(a, x, f0);
        for (int i = 0; i < ns; i++)
            y[i] = x[i] + (0.5 * h) * f0[i];
        derivative(mid, y, k2);
        for (int i = 0; i < ns; i++)
            y[i] = x[i] + (0.5 * h) * k2[i];
        derivative(mid, y, k3);
        for (int i = 0; i < ns; i++)
            y[i] = x[i] + h * k3[i];
        derivative(b, y, k4);
        for (int i = 0; i < ns; i++)
            y[i] = x[i] + (h / 6.0) * (f0[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        take_states(a, b);
        take_at_start(a);
        slope_known = readings_before(b);
        if (slope_known) {
            derivative(b, y, f1);
            take_readings(a, b, y);
        }
        for (int i = 0; i < ns; i++) {
            x[i] = y[i];
            if (slope_known)
                f0[i] = f1[i];
        }
        for (int i = 0; i < ns; i++)
            if (!(value_of(x[i]) < 1e6 && value_of(x[i]) > -1e6))
                k.finite = false;
    }

    double time_of(int j, long row) const { return d.t[row] - value_of(old[j]); }
    bool pending(int j, double before) const
    {
        return next[j] < (long)d.rows && time_of(j, next[j]) < before;
    }
    bool readings_before(double b) const
    {
        for (int j = 0; j < c.joints; j++)
            if (pending(j, b - 1e-9))
                return true;
        return false;
    }
    // Readings that fall on the start of a step need no interpolation.
    void take_at_start(double a)
    {
        for (int j = 0; j < c.joints; j++)
            while (pending(j, a + 1e-9)) {
                compare(j, next[j], x, f0, d.t[next[j]] - value_of(old[j]));
                next[j]++;
            }
    }
    void take_readings(double a, double b, const Scalar *y)
    {
        for (int j = 0; j < c.joints; j++)
            while (pending(j, b - 1e-9)) {
                double t = time_of(j, next[j]);
                Scalar at[MK_MAX_STATES], slope[MK_MAX_STATES];
                interpolate(a, b, y, t, at, slope);
                compare(j, next[j], at, slope, t);
                next[j]++;
            }
    }
    // Cubic Hermite between both ends of a step.
    void interpolate(double a, double b, const Scalar *y, double t, Scalar *at, Scalar *slope) const
    {
        double h = b - a, s = (t - a) / h, r = 1.0 - s;
        double h00 = (1.0 + 2.0 * s) * r * r, h10 = h * s * r * r, h01 = s * s * (3.0 - 2.0 * s),
               h11 = -h * s * s * r;
        double g00 = -6.0 * s * r / h, g10 = r * (1.0 - 3.0 * s), g11 = s * (3.0 * s - 2.0);
        for (int i = 0; i < c.state_count; i++) {
            at[i] = h00 * x[i] + h10 * f0[i] + h01 * y[i] + h11 * f1[i];
            slope[i] = g00 * x[i] + g10 * f0[i] - g00 * y[i] + g11 * f1[i];
        }
    }
    void read_up_to_end()
    {
        double none = k.end + 1e-9;
        if (!slope_known)
            derivative(k.end, x, f0);
        take_states(k.end, none);
        for (int j = 0; j < c.joints; j++)
            while (pending(j, none)) {
                compare(j, next[j], x, f0, time_of(j, next[j]));
                next[j]++;
            }
    }
    void take_states(double a, double b)
    {
        if (!k.x_at)
            return;
        for (; next_state < (long)d.rows && d.t[next_state] < b - 1e-9; next_state++) {
            double dt = d.t[next_state] - a;
            for (int i = 0; i < c.state_count; i++)
                k.x_at[next_state * c.state_count + i] = value_of(x[i]) + dt * value_of(f0[i]);
        }
    }

    void compare(int j, long row, const Scalar *at, const Scalar *slope, double t)
    {
        double w = d.w[j][row];
        if (!(w > 0.0) || rows >= k.row_capacity)
            return;
        Scalar y[MK_MAX_JOINTS], seen[MK_MAX_STATES];
        Scalar early = value_of(old[j]) - old[j];
        for (int i = 0; i < c.state_count; i++)
            seen[i] = at[i] + early * value_of(slope[i]);
        measure(c, Scalar(t), seen, y);
        double reading = d.q[j][row] - (d.shift[j] ? d.shift[j][row] : 0.0);
        k.residual[rows] = w * (reading - value_of(y[j]));
        store_scaled(y[j], w, k.jac + (long)rows * k.columns);
        if (k.row_of)
            k.row_of[rows] = (int)row;
        if (k.joint_of)
            k.joint_of[rows] = j;
        rows++;
    }
    void store_scaled(const Scalar &y, double w, double *row) const
    {
        for (int i = 0; i < MK_LANES && first + i < k.columns; i++)
            row[first + i] = w * slope_of(y, i);
    }
    void store(const Scalar &y, double *row) const { store_scaled(y, 1.0, row); }
};

static void run(ShootTask &task, int first_column)
{
    with_plant(task.model->plant, [&](auto law) {
        Shooter<decltype(law)> shooter(task, first_column);
        shooter.run();
    });
}

extern const ShootKernel shoot_kernel;
const ShootKernel shoot_kernel = {MK_LANES, run};

} // namespace MK_KERNEL_NS
} // namespace mk

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
    size_t rows = 0;
    bool stiff = false;        // an effect has a rate
    int speeds[MK_MAX_STATES]; // places of the speeds that friction acts on
    int speed_count = 0;
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
        constexpr unsigned between = MK_STAGE_STATE | MK_STAGE_MEASUREMENT;
        int states = 2 * c.joints;
        for (int j = 0; j < c.joints; j++)
            speeds[speed_count++] = c.joints + j;
        for (int e = 0; e < c.effect_count; e++) {
            const mk_effect_info *info = mk_effect(c.effect[e].index);
            // A body of its own between joint and encoder: angle, speed.
            if ((info->stages & between) == between)
                speeds[speed_count++] = states + 1;
            states += info->state_count;
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
        double left = from, right = from;
        long fine = sharp_reversal(length, left, right);
        if (fine == 0) {
            run_steps(from, to, reversal_steps(length));
            return;
        }
        run_steps(from, left, 1);
        run_steps(left, right, fine);
        run_steps(right, to, 1);
    }
    void run_steps(double from, double to, long count)
    {
        double length = to - from;
        if (!(length > 0.0) || !k.finite)
            return;
        long usual = (long)(length / k.step + 0.999);
        count = usual > count ? usual : count;
        if (stiff) {
            double rate = fastest_rate(c, Scalar(from), x) * length / 1.6;
            count = rate > (double)count ? (long)(rate < 24.0 ? rate + 1.0 : 24.0) : count;
        }
        double h = length / (double)count;
        for (long i = 0; i < count && k.finite; i++)
            step(from + h * (double)i, i + 1 == count ? to : from + h * (double)(i + 1));
    }
    // A light wheel runs through the whole turn of its friction within a fraction of a step: when,
    // and how many steps it takes to follow. 0: no such thing.
    long sharp_reversal(double length, double &left, double &right) const
    {
        for (int j = 0; j < speed_count; j++) {
            double v = value_of(x[speeds[j]]), a = value_of(f0[speeds[j]]);
            double reach = 0.35 / fabs(a), middle = -v / a;
            if (!(fabs(a) * length > 0.4) || middle + reach < 0.0 || middle - reach > length)
                continue;
            double from = left;
            left = from + (middle > reach ? middle - reach : 0.0);
            right = from + (middle + reach < length ? middle + reach : length);
            return (long)(14.0 * (right - left) / (2.0 * reach)) + 1;
        }
        return 0;
    }
    // Friction turns over within |v| < 0.2 rad/s; a step must resolve that.
    long reversal_steps(double length) const
    {
        long count = 1;
        for (int j = 0; j < speed_count; j++) {
            double v = fabs(value_of(x[speeds[j]])), dv = fabs(value_of(f0[speeds[j]])) * length;
            long need = v < 0.2 + dv ? (long)(dv / 0.05) + 1 : 1;
            if (need > count)
                count = need < 8 ? need : 8;
        }
        return count;
    }

    // The classical Runge-Kutta method over a step that may depend on what is differentiated by.
    template <class H>
    void runge_kutta(double a, const H &h, Scalar *y) const
    {
        k.steps++;
        const int ns = c.state_count;
        double mid = a + 0.5 * value_of(h), b = a + value_of(h);
        Scalar k2[MK_MAX_STATES], k3[MK_MAX_STATES], k4[MK_MAX_STATES];
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
            y[i] = x[i] + (h * (1.0 / 6.0)) * (f0[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
    }

    // One step; where a law switches inside (contact), it ends there and another goes on.
    void step(double a, double b)
    {
        Scalar y[MK_MAX_STATES];
        if (!slope_known)
            derivative(a, x, f0);
        slope_known = true;
        if (c.event_count == 0) {
            runge_kutta(a, b - a, y);
            arrive(a, b, y);
            return;
        }
        Scalar start = Scalar(a);
        for (int part = 0;; part++) {
            Scalar h = Scalar(b) - start;
            runge_kutta(value_of(start), h, y);
            Scalar to_switch;
            if (part == 6 || !switches(value_of(start), h, y, to_switch)) {
                arrive(value_of(start), b, y);
                return;
            }
            runge_kutta(value_of(start), to_switch, y);
            double from = value_of(start);
            start += to_switch;
            arrive(from, value_of(start), y);
            if (!k.finite)
                return;
            derivative(value_of(start), x, f0);
            slope_known = true;
        }
    }

    // Whether a law switches on the way to y, and after how long (just past it).
    bool switches(double a, const Scalar &h, const Scalar *y, Scalar &to_switch) const
    {
        constexpr double PAST = 1e-8; // s
        Scalar ga[MK_MAX_EVENTS], gb[MK_MAX_EVENTS];
        mk::events(c, Scalar(a), x, ga);
        mk::events(c, Scalar(a + value_of(h)), y, gb);
        int which = -1;
        double share = 1.0;
        for (int e = 0; e < c.event_count; e++) {
            double va = value_of(ga[e]), vb = value_of(gb[e]);
            if ((va > 0.0) == (vb > 0.0) || value_of(h) < 10.0 * PAST)
                continue;
            if (va / (va - vb) <= share) {
                share = va / (va - vb);
                which = e;
            }
        }
        if (which < 0)
            return false;
        Scalar slope = (gb[which] - ga[which]) / h;
        Scalar guess = h * (ga[which] / (ga[which] - gb[which]));
        for (int round = 0; round < 3; round++) {
            Scalar at[MK_MAX_STATES], g[MK_MAX_EVENTS];
            runge_kutta(a, guess, at);
            mk::events(c, Scalar(a + value_of(guess)), at, g);
            guess -= g[which] / slope;
            if (!(value_of(guess) > 0.0))
                guess = guess - value_of(guess) + 1e-3 * value_of(h);
            if (!(value_of(guess) < value_of(h)))
                guess = guess - value_of(guess) + 0.999 * value_of(h);
        }
        to_switch = guess + PAST;
        return value_of(to_switch) < value_of(h);
    }

    // Takes what was read on the way from a to b and moves to y.
    void arrive(double a, double b, const Scalar *y)
    {
        const int ns = c.state_count;
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
        for (int j = 0; j < c.joints; j++)
            while (pending(j, none)) {
                compare(j, next[j], x, f0, time_of(j, next[j]));
                next[j]++;
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
        k.residual[rows] = w * (d.q[j][row] - value_of(y[j]));
        store_scaled(y[j], w, k.jac + (long)rows * k.columns);
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

// The shooting kernel of one instruction set (MK_ISA), for MK_WIDTH shooting intervals side by
// side, with derivatives (MK_DERIVATIVES) or without. As in fast_kernel.cc nothing here may leak
// through the linker.
//
// It integrates dx/dt = f(x, u, p, t) over each interval from its start state, compares the
// trajectory with the readings,
//     r_k = w_k (y_k - h(x(t_k), p)) ,
// and differentiates all of it by the columns c = (start state x_0, free parameters p). The method
// is the classical Runge-Kutta method of fourth order with fixed steps between the edges of the
// command.
//
// Derivatives are those of the numbers that the method computes, not of the exact solution
// (internal differentiation, H. G. Bock 1981): they belong to the residuals exactly, at any step
// length. f is differentiated by what it sees, state and parameters (forward mode,
// model/sparse_dual.hpp); what the state itself depends on is carried along as columns X = dx/dc:
//     df/dc = (df/dx) X + df/dp dp/dc                                 (chain) ,
//     dX/dt = df/dc , X(0) = (1 0)   by the same Runge-Kutta stages as x.
//
// Where f is not smooth the instant tau of the change depends on the columns too, and a trajectory
// that changes its slope there from f_before to f_after gains
//     X <- X + (f_before - f_after) dtau/dc .
// This is done at edges of a command with a delay that is fitted (follow_edges), and where a law
// switches, as in contact (step_to_switch): tau then comes from the switching function g(x, p) = 0
// by the implicit function theorem.
//
// Every interval has a lane of its own: it goes at its own pace, with its own steps, and when it
// arrives the next one takes its place. What comes out does not depend on who travels beside it.
#include "model/rhs.hpp"
#include "model/simd.hpp"
#include "model/sparse_dual.hpp"
#include "sim/shoot.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

constexpr int W = MK_WIDTH;
#if MK_WIDTH > 1
using Base = Pack<W>;
inline double get(const Base &x, int lane)
{
    return x[lane];
}
inline void put(Base &x, int lane, double value)
{
    x.set(lane, value);
}
inline bool all_below(const Base &x, double limit)
{
    bool all = true;
    for (int i = 0; i < W; i++)
        all = all && x[i] < limit;
    return all;
}
#else
using Base = double;
inline double get(double x, int)
{
    return x;
}
inline void put(double &x, int, double value)
{
    x = value;
}
inline bool all_below(double x, double limit)
{
    return x < limit;
}
#endif

#if MK_DERIVATIVES
using Scalar = SparseDual<Base>;
constexpr int MOST_COLUMNS = Scalar::MOST;
inline const Base &base_of(const Scalar &x)
{
    return x.v;
}
#else
using Scalar = Base;
constexpr int MOST_COLUMNS = 0;
inline const Base &base_of(const Scalar &x)
{
    return x;
}
#endif

// A state x, or its slope f, of all lanes, and what it depends on: derivative of number i by column
// c in d[i * columns + c].
struct Point {
    Base v[MK_MAX_STATES];
    Base d[MK_MAX_STATES * MOST_COLUMNS + 1];
};
// Derivatives of one number.
struct Row {
    Base d[MOST_COLUMNS + 1];
};

// A time that never comes, s.
constexpr double NONE = 1e300;
// How far past a switch a step ends, s, so that the next one starts under the new law.
constexpr double PAST = 1e-8;
// Switches within one planned step that are looked for; further ones are stepped over.
constexpr int MOST_PARTS = 6;

// One stretch on its way.
struct Lane {
    ShootTask *task;          // NULL: the lane is idle
    long command;             // row in force
    long next[MK_MAX_JOINTS]; // first reading not yet taken
    size_t rows;              // readings taken
    double now;
    bool edge; // a new command has just taken over

    // Until the command's next edge, in up to three runs of equal steps.
    double stop[3];
    long least[3]; // steps of a run
    int run, runs;
    // The run.
    double from, to, h;
    long step, steps;
    // The step that is being taken: where it shall end, and how often a law has switched in it.
    double target;
    int switched;
};

template <class Law>
class Shooter
{
  public:
    // Derivatives by the start state and by free parameters first_free ... of as many as there is
    // room for: `columns` in all.
    Shooter(ShootTask *tasks, int count, int first_free)
        : k(tasks[0]), c(compile<Scalar>(*k.model)), bare(compile<Base>(*k.model)),
          plain(compile<double>(*k.model)), ns(c.state_count), first(first_free), queue(tasks),
          waiting(count)
    {
#if MK_DERIVATIVES
        int room = MOST_COLUMNS - ns, left = k.columns - ns - first;
        columns = ns + (left < room ? left : room);
#endif
        seed();
        for (int i = 0; i < W; i++)
            lane[i].task = nullptr;
        for (int i = 0; i < ns; i++)
            x.v[i] = Base(0.0);
        for (int i = 0; i < ns * columns; i++)
            x.d[i] = Base(0.0);
        for (int i = 0; i < columns; i++)
            passed.d[i] = Base(0.0);
        u[0] = u[1] = now = start = Base(0.0);
    }
    int parameters_done() const
    {
        return columns - ns;
    }

    // One turn of the loop takes every lane one step further: slopes at its start (f0, known from
    // the step before where readings lay within it and no command has changed), derivatives of
    // moving edges, readings at its start, the step, readings within it.
    void run()
    {
        for (int i = 0; i < W; i++)
            board(i);
        while (busy > 0) {
            if (!slopes_known)
                derivative(now, x, f0);
            slopes_known = true;
            if (edges_move)
                follow_edges();
            if (retire_lanes()) {
                slopes_known = false;
                continue;
            }
            plan();
            take_at_start();
            step();
        }
    }

  private:
    const ShootTask &k; // what all tasks share
    Compiled<Scalar> c;
    Compiled<Base> bare;    // the same without derivatives
    Compiled<double> plain; // and without lanes
    const int ns;
    int first; // free parameter of the first column after the states'
#if MK_DERIVATIVES
    int columns = 0; // derivatives of a number
#else
    static constexpr int columns = 0;
#endif
    ShootTask *queue; // tasks that wait
    int waiting, busy = 0;
    Lane lane[W];
    Point x, f0;            // where the lanes are, and the slopes there
    Point y, f1;            // the same at the end of a step
    Point stage, stage_sum; // the slopes of a stage, and their sum
    Point between, older;
    Base u[MK_MAX_INPUTS], now;
    Base start;                     // of each lane's rows in their log, s
    Scalar seen[MK_MAX_STATES];     // the state as laws see it
    Base before[MK_MAX_STATES];     // slopes under the last command
    Row passed;                     // of the start of a step at an instant where a law switched
    double late = 0.0;              // delay of the command
    double age[MK_MAX_JOINTS] = {}; // of each joint's readings
    // Derivatives of these by the columns, the same in all lanes.
    double late_slope[MOST_COLUMNS + 1] = {}, age_slope[MK_MAX_JOINTS][MOST_COLUMNS + 1] = {};
    bool edges_move = false, ages_move = false; // there are any
    bool stiff = false;                         // an effect has a rate
    bool on_switch = false;                     // some lane is at a switch: `passed` counts
    // Places of the speeds that friction acts on, and how many rad/s stand for one unit of each:
    // k / 15 with the sharpness k of the joint, 1 for joints that turn.
    int speeds[MK_MAX_STATES];
    double in_radps[MK_MAX_STATES];
    int speed_count = 0;
    bool slopes_known = false; // f0 belongs to x

    // The time that laws see: it counts from the start of the log, whose rows may begin later.
    Base in_log(const Base &t) const
    {
        return start + t;
    }
    // Makes a parameter depend on its column.
    void vary(Scalar &parameter, int column, double slope)
    {
#if MK_DERIVATIVES
        parameter.seed(column, Base(slope));
#else
        (void)parameter, (void)column, (void)slope;
#endif
    }
    // Slope and column of the first parameter of each effect, which of a delay is the delay.
    struct FirstParameters {
        double slope[MK_MAX_EFFECTS] = {};
        int column[MK_MAX_EFFECTS] = {};
    };
    // Each free parameter is a column: dp/dc is its scale in its own column and 0 elsewhere.
    FirstParameters seed_parameters()
    {
        FirstParameters by_effect;
        for (int f = first; f - first < columns - ns; f++) {
            int number = k.free[f], place = ns + f - first;
            if (number < c.parameter_count) {
                vary(c.p[number], place, k.scale[f]);
                continue;
            }
            number -= c.parameter_count;
            for (int e = 0; e < c.effect_count; e++) {
                int count = mk_effect(c.effect[e].index)->parameter_count;
                if (number >= 0 && number < count)
                    vary(c.effect[e].p[number], place, k.scale[f]);
                if (number == 0) {
                    by_effect.slope[e] = k.scale[f];
                    by_effect.column[e] = place;
                }
                number -= count;
            }
        }
        return by_effect;
    }
    // Speeds at which friction may reverse: those of the joints, and that of the light side of a
    // backlash, which is a body of its own between joint and encoder (angle, speed).
    void find_speeds()
    {
        constexpr unsigned apart = MK_STAGE_STATE | MK_STAGE_MEASUREMENT;
        int states = 2 * c.joints;
        for (int j = 0; j < c.joints; j++)
            add_speed(c.joints + j, j);
        for (int e = 0; e < c.effect_count; e++) {
            const mk_effect_info *info = mk_effect(c.effect[e].index);
            if ((info->stages & apart) == apart)
                add_speed(states + 1, std::max(c.effect[e].joint, 0));
            states += info->state_count;
        }
    }
    void find_delays(const FirstParameters &by_effect)
    {
        for (int e = 0; e < c.effect_count; e++) {
            const mk_effect_info *info = mk_effect(c.effect[e].index);
            const double slope = by_effect.slope[e];
            const int column = by_effect.column[e];
            if (info->stages & MK_STAGE_COMMAND_DELAY) {
                late += plain.effect[e].p[0];
                late_slope[column] += slope;
                edges_move = edges_move || slope != 0.0;
            }
            for (int j = 0; j < c.joints && (info->stages & MK_STAGE_SENSOR_DELAY); j++)
                if (c.effect[e].joint < 0 || c.effect[e].joint == j) {
                    age[j] += plain.effect[e].p[0];
                    age_slope[j][column] += slope;
                    ages_move = ages_move || slope != 0.0;
                }
        }
    }
    void seed()
    {
        // Columns 0 .. ns - 1 are the start state; a law sees the state as variables of its own, of
        // slope 1, and chain() puts the real columns in.
        const FirstParameters by_effect = seed_parameters();
        for (int i = 0; i < ns; i++) {
            seen[i] = Scalar(0.0);
            vary(seen[i], i, 1.0);
        }
        find_speeds();
        for (int e = 0; e < c.effect_count; e++)
            stiff = stiff || effect_ops<double>(c.effect[e].index).rate;
        find_delays(by_effect);
    }
    double state(int i, int at) const
    {
        return get(x.v[at], i);
    }
    double slope(int i, int at) const
    {
        return get(f0.v[at], i);
    }

    // --- who travels ---

    // The next task takes a lane.
    void board(int i)
    {
        Lane &l = lane[i];
        l.task = nullptr;
        if (waiting == 0)
            return;
        waiting--;
        busy++;
        l.task = queue++;
        l.task->finite = true;
        l.task->steps = 0;
        l.rows = 0;
        l.edge = false;
        l.run = l.runs = 0;
        l.step = l.steps = 0;
        l.switched = 0;
        place(i);
        for (int d = 0; d < columns; d++)
            put(passed.d[d], i, 0.0);
        l.now = l.task->begin;
        put(now, i, l.now);
        const ShootData &d = *l.task->data;
        put(start, i, d.start);
        long row = first_row(l, late);
        // Command in force at the begin: that of the last row whose time, late by the delay, has
        // come.
        bool on_edge = row < (long)d.rows && d.t[row] + late <= l.task->begin + 1e-9;
        set_command(i, on_edge ? row : row - 1);
        for (int j = 0; j < c.joints; j++)
            l.next[j] = l.task->end_row ? (long)l.task->first_row : first_row(l, -age[j]);
    }
    // At the start state of its task.
    void place(int i)
    {
        for (int s = 0; s < ns; s++) {
            put(x.v[s], i, lane[i].task->x[s]);
            for (int d = 0; d < columns; d++)
                // X(0): by the start state unity, by parameters nothing.
                put(x.d[s * columns + d], i, d == s ? 1.0 : 0.0);
        }
    }
    // First row whose time, shifted by `by`, is not before the begin.
    static long first_row(const Lane &l, double by)
    {
        const ShootData &d = *l.task->data;
        long low = 0, high = (long)d.rows;
        while (low < high) {
            long mid = (low + high) / 2;
            if (d.t[mid] + by < l.task->begin - 1e-9)
                low = mid + 1;
            else
                high = mid;
        }
        return low;
    }
    // Lanes that have arrived hand in what they found. Whether any did.
    // Lanes whose interval has ended, or whose trajectory ran away, hand in what they found; the
    // next tasks take their places. Whether any did.
    bool retire_lanes()
    {
        bool any = false;
        for (int i = 0; i < W; i++)
            any = any || arrived(lane[i]);
        if (!any)
            return false;
        for (int j = 0; j < c.joints; j++)
            take_up_to_end(j);
        for (int i = 0; i < W; i++) {
            if (!arrived(lane[i]))
                continue;
            ShootTask &task = *lane[i].task;
            for (int s = 0; s < ns; s++) {
                task.x_end[s] = state(i, s);
                store(x.d + s * columns, i, 1.0, task.jac_end + (long)s * task.columns);
            }
            task.row_count = lane[i].rows;
            busy--;
            place(i); // what stays in an idle lane must be numbers
            board(i);
        }
        return true;
    }
    static bool arrived(const Lane &l)
    {
        return l.task && (!l.task->finite || !(l.now < l.task->end));
    }

    // --- commands ---

    void set_command(int i, long row)
    {
        const ShootData &d = *lane[i].task->data;
        lane[i].command = row;
        // Before the first row the motor was off.
        put(u[0], i, row >= 0 ? d.u[0][row] : 0.0);
        put(u[1], i, row >= 0 && d.u[1] ? d.u[1][row] : 0.0);
    }
    // Row of the next command; where the task says so, of one that differs, as far as a step
    // reaches.
    long next_command(const Lane &l) const
    {
        const ShootData &d = *l.task->data;
        const long now_row = l.command;
        long row = now_row + 1;
        while (l.task->edges_differ && now_row >= 0 && row < (long)d.rows &&
               d.t[row] - d.t[now_row] < k.step && d.u[0][row] == d.u[0][now_row] &&
               (!d.u[1] || d.u[1][row] == d.u[1][now_row]))
            row++;
        return row;
    }
    double next_edge(const Lane &l) const
    {
        const ShootData &d = *l.task->data;
        const long row = next_command(l);
        return row < (long)d.rows ? d.t[row] + late : NONE;
    }
    // Commands whose time has come take over.
    void turn()
    {
        bool any = false;
        for (int i = 0; i < W; i++)
            any = any || due(lane[i]);
        if (!any)
            return;
        if (edges_move) {
            bare_slopes(now, x.v, before);
        }
        for (int i = 0; i < W; i++) {
            Lane &l = lane[i];
            while (due(l)) {
                set_command(i, next_command(l));
                l.edge = true;
            }
        }
        slopes_known = false;
    }
    bool due(const Lane &l) const
    {
        if (!l.task || !l.task->finite)
            return false;
        double edge = next_edge(l);
        return edge <= l.now && edge <= l.task->end;
    }
    // An edge at t_e + late moves with the delay `late`. The command before it acts longer, the one
    // after it shorter, by d(late)/dc:
    //     X <- X + (f_before - f_after) d(late)/dc .
    // `before` holds f_before, f0 is f_after.
    void follow_edges()
    {
        bool any = false;
        for (int i = 0; i < W; i++)
            any = any || (lane[i].task && lane[i].edge);
        if (!any)
            return;
        for (int s = 0; s < ns; s++) {
            Base change = Base(0.0);
            for (int i = 0; i < W; i++)
                if (lane[i].task && lane[i].edge)
                    put(change, i, get(before[s], i) - slope(i, s));
            for (int d = 0; d < columns; d++)
                x.d[s * columns + d] += late_slope[d] * change;
        }
        for (int i = 0; i < W; i++)
            lane[i].edge = false;
        derivative(now, x, f0);
    }

    // --- steps ---

    // f and df/dc at a state.
    void derivative(const Base &t, const Point &at, Point &f)
    {
        Scalar dx[MK_MAX_STATES];
        look_at(at.v);
        rhs_of<Law>(c, in_log(t), seen, u, dx);
        for (int i = 0; i < ns; i++) {
            f.v[i] = base_of(dx[i]);
            chain(dx[i], at, f.d + i * columns);
        }
    }
    void bare_slopes(const Base &t, const Base *at, Base *dx) const
    {
        rhs_of<Law>(bare, in_log(t), at, u, dx);
    }
    void look_at(const Base *v)
    {
        for (int i = 0; i < ns; i++)
#if MK_DERIVATIVES
            seen[i].v = v[i];
#else
            seen[i] = v[i];
#endif
    }
    // row = sum_i by[i] from[i], over all columns. N is how many terms there are where the compiler
    // shall unroll them; 0: n of them.
    template <int N>
    void weigh(int n, const Base *by, const Base *const *from, Base *row) const
    {
        for (int d = 0; d < columns; d++) {
            Base sum = Base(0.0);
            for (int i = 0; i < (N ? N : n); i++)
                sum += by[i] * from[i][d];
            row[d] = sum;
        }
    }
    // The chain rule. A law made `number` of the state and the parameters; mask says by what it was
    // differentiated, bits below ns for states:
    //     d number/dc = sum_s (d number/dx_s) X_sc + d number/dp_c .
    // Most laws see one to six states, for which weigh() is unrolled.
    void chain(const Scalar &number, const Point &at, Base *row) const
    {
        chain_rows(
            number, [&](int i) { return at.d + i * columns; }, row);
    }
    template <class RowOf>
    void chain_rows(const Scalar &number, RowOf &&row_of, Base *row) const
    {
#if MK_DERIVATIVES
        int n = 0;
        const Base *from[MK_MAX_STATES];
        Base by[MK_MAX_STATES];
        Scalar::each(number.mask & ((1u << ns) - 1u), [&](int s) {
            from[n] = row_of(s);
            by[n++] = number.d[s];
        });
        switch (n) {
        case 1:
            weigh<1>(n, by, from, row);
            break;
        case 2:
            weigh<2>(n, by, from, row);
            break;
        case 3:
            weigh<3>(n, by, from, row);
            break;
        case 4:
            weigh<4>(n, by, from, row);
            break;
        case 5:
            weigh<5>(n, by, from, row);
            break;
        case 6:
            weigh<6>(n, by, from, row);
            break;
        default:
            weigh<0>(n, by, from, row);
        }
        // What depends on a parameter directly, beside what the state carries of it.
        Scalar::each(number.mask & ~((1u << ns) - 1u), [&](int d) { row[d] += number.d[d]; });
#else
        (void)number, (void)row_of, (void)row;
#endif
    }
    // Where each lane's step shall end.
    void plan()
    {
        for (int i = 0; i < W; i++) {
            Lane &l = lane[i];
            if (!l.task || l.switched > 0)
                continue;
            while (l.step == l.steps) {
                if (l.run == l.runs)
                    begin_interval(i);
                begin_run(i);
            }
            // The last step of a run ends on its end to the last digit.
            l.target = l.step + 1 == l.steps ? l.to : l.from + l.h * (double)(l.step + 1);
        }
    }
    // From here to the next edge or the end, under one command. Three runs of equal steps where
    // friction reverses fast within it: up to the reversal, through it in `fine` steps, and behind
    // it. Else one.
    void begin_interval(int i)
    {
        Lane &l = lane[i];
        double edge = next_edge(l), stop = edge < l.task->end ? edge : l.task->end;
        double length = stop - l.now, left = l.now, right = l.now;
        long fine = sharp_reversal(i, length, left, right);
        l.run = 0;
        l.runs = fine == 0 ? 1 : 3;
        l.stop[0] = fine == 0 ? stop : left;
        l.least[0] = fine == 0 ? reversal_steps(i, length) : 1;
        l.stop[1] = right;
        l.least[1] = fine;
        l.stop[2] = stop;
        l.least[2] = 1;
    }
    void begin_run(int i)
    {
        Lane &l = lane[i];
        // A run of n equal steps, n the least number with steps no longer than k.step, or what the
        // run asks for. 0.999 forgives rounding.
        double length = l.stop[l.run] - l.now;
        long count = l.least[l.run], usual = (long)(length / k.step + 0.999);
        l.from = l.now;
        l.to = l.stop[l.run++];
        l.step = l.steps = 0;
        if (!(length > 0.0))
            return;
        count = usual > count ? usual : count;
        // An explicit method is stable where h times the fastest rate stays below some 2.8, the
        // length of the classical method's stability interval on the negative real axis (E. Hairer,
        // G. Wanner, Solving Ordinary Differential Equations II, 1996, IV.2). h rate is
        // kept at 1.6 or below, with 24 steps at most in every 5 ms: a stiffer law is stepped too
        // coarsely, runs away, and is told apart so.
        if (stiff) {
            double at[MK_MAX_STATES];
            for (int s = 0; s < c.state_count; s++)
                at[s] = state(i, s);
            double most = 24.0 * (double)((long)(length / 5e-3 - 1e-6) + 1);
            double rate = fastest_rate(plain, l.task->data->start + l.now, at) * length / 1.6;
            count = rate > (double)count ? (long)(rate < most ? rate + 1.0 : most) : count;
        }
        l.steps = count;
        l.h = length / (double)count;
    }
    void add_speed(int place, int joint)
    {
        speeds[speed_count] = place;
        in_radps[speed_count++] = c.sharpness[joint] / MK_FRICTION_SHARPNESS_TURNING;
    }
    // Friction c v + F tanh(15 v), v in rad/s, turns over within |v| < 0.35 or so. A light wheel
    // with acceleration a runs through that within a fraction of a step. With v and a as they are
    // now the reversal is at t = -v/a and takes 0.35/|a| either way; that part is stepped through
    // at 0.7/14 = 0.05 rad/s a step. Returns how many steps it takes, and when; 0 where speeds
    // change by less than 0.4 rad/s until the next edge, or nothing reverses.
    long sharp_reversal(int i, double length, double &left, double &right) const
    {
        for (int j = 0; j < speed_count; j++) {
            double v = in_radps[j] * state(i, speeds[j]), a = in_radps[j] * slope(i, speeds[j]);
            if (!(fabs(a) * length > 0.4))
                continue;
            double reach = 0.35 / fabs(a), middle = -v / a;
            if (middle + reach < 0.0 || middle - reach > length)
                continue;
            double from = left;
            left = from + (middle > reach ? middle - reach : 0.0);
            right = from + (middle + reach < length ? middle + reach : length);
            // A whole turn, by far the most frequent, must not be 14 or 15 steps by rounding.
            return (long)(13.999 * (right - left) / (2.0 * reach)) + 1;
        }
        return 0;
    }
    // The same for slower reversals, by the steps of the whole interval: where the speed comes to
    // within 0.2 rad/s of 0, a step shall change it by 0.05 rad/s at most. Not more than 8 steps.
    long reversal_steps(int i, double length) const
    {
        long count = 1;
        for (int j = 0; j < speed_count; j++) {
            double v = in_radps[j] * fabs(state(i, speeds[j]));
            double dv = in_radps[j] * fabs(slope(i, speeds[j])) * length;
            long need = v < 0.2 + dv ? (long)(dv / 0.05) + 1 : 1;
            if (need > count)
                count = need < 8 ? need : 8;
        }
        return count;
    }

    // The classical Runge-Kutta method from x to y, with k1 = f0 known:
    //     k2 = f(t + h/2, x + h/2 k1) ,  k3 = f(t + h/2, x + h/2 k2) ,  k4 = f(t + h, x + h k3) ,
    //     y  = x + h/6 (k1 + 2 k2 + 2 k3 + k4) .
    // The columns take the same steps with dk/dc in the place of k. stage_sum is k1 + 2 k2 + 2 k3.
    void runge_kutta(const Base &h)
    {
        Base half = 0.5 * h, sixth = (1.0 / 6.0) * h, mid = now + half;
        first_stage(half);
        derivative(mid, y, stage);
        next_stage(half);
        derivative(mid, y, stage);
        next_stage(h);
        derivative(now + h, y, stage);
        for (int i = 0; i < ns; i++)
            y.v[i] = x.v[i] + sixth * (stage_sum.v[i] + stage.v[i]);
        for (int i = 0; i < ns * columns; i++)
            y.d[i] = x.d[i] + sixth * (stage_sum.d[i] + stage.d[i]);
    }
    // y = x + h k1, and the sum of slopes begins.
    void first_stage(const Base &h)
    {
        for (int i = 0; i < ns; i++)
            stage_sum.v[i] = f0.v[i], y.v[i] = x.v[i] + h * f0.v[i];
        for (int i = 0; i < ns * columns; i++)
            stage_sum.d[i] = f0.d[i], y.d[i] = x.d[i] + h * f0.d[i];
    }
    // y = x + h k, k the slope of the stage before.
    void next_stage(const Base &h)
    {
        for (int i = 0; i < ns; i++)
            stage_sum.v[i] += 2.0 * stage.v[i], y.v[i] = x.v[i] + h * stage.v[i];
        for (int i = 0; i < ns * columns; i++)
            stage_sum.d[i] += 2.0 * stage.d[i], y.d[i] = x.d[i] + h * stage.d[i];
    }
    // The same without derivatives, to look ahead.
    void bare_runge_kutta(const Base &h, Base *to) const
    {
        Base half = 0.5 * h, mid = now + half;
        Base a[MK_MAX_STATES], b[MK_MAX_STATES], e[MK_MAX_STATES];
        for (int i = 0; i < ns; i++)
            to[i] = x.v[i] + half * f0.v[i];
        bare_slopes(mid, to, a);
        for (int i = 0; i < ns; i++)
            to[i] = x.v[i] + half * a[i];
        bare_slopes(mid, to, b);
        for (int i = 0; i < ns; i++)
            to[i] = x.v[i] + h * b[i];
        bare_slopes(now + h, to, e);
        for (int i = 0; i < ns; i++)
            to[i] = x.v[i] + (1.0 / 6.0) * h * (f0.v[i] + 2.0 * (a[i] + b[i]) + e[i]);
    }
    void count_steps(const bool *who)
    {
        for (int i = 0; i < W; i++)
            if (lane[i].task && (!who || who[i]))
                lane[i].task->steps++;
    }

    void step()
    {
        // Idle lanes take a step of length 0.
        Base end = now;
        for (int i = 0; i < W; i++)
            if (lane[i].task)
                put(end, i, lane[i].target);
        count_steps(nullptr);
        if (c.event_count == 0)
            runge_kutta(end - now);
        else
            step_to_switch(end);
        arrive(end);
    }

    // Where a law switches inside a step (contact), the step ends just past the switch, and another
    // goes on. In lanes that switch:
    //
    // 1. find_switch() looks ahead without derivatives and shortens h to tau - now + PAST.
    //
    // 2. A law may jump at its switch, and all stages of a step must see one law. So the
    // Runge-Kutta step goes up to `hop` before its end, and a straight line under the old law
    // covers the rest:
    //     y <- y + hop f(y) ,   hop = 2 PAST + h / 1000 ,   the columns likewise.
    //
    // 3. move_instants() adds what the instant depends on.
    void step_to_switch(Base &end)
    {
        Base h = end - now, hop = Base(0.0), bare_y[MK_MAX_STATES];
        bool switching[W], any = false;
        int which[W];
        bare_runge_kutta(h, bare_y);
        if (find_switch(h, bare_y, which)) {
            for (int i = 0; i < W; i++) {
                switching[i] = which[i] >= 0;
                any = any || switching[i];
                if (!switching[i])
                    continue;
                put(end, i, get(now, i) + get(h, i));
                put(hop, i, 2.0 * PAST + 1e-3 * get(h, i));
            }
            count_steps(switching);
        }
        // A law may jump at its switch: up to there all of the step is under the old one.
        runge_kutta(h - hop);
        if (!any && !on_switch)
            return;
        derivative(end - hop, y, stage);
        for (int s = 0; s < ns; s++)
            y.v[s] += hop * stage.v[s];
        for (int d = 0; d < ns * columns; d++)
            y.d[d] += hop * stage.d[d];
        move_instants(end, any ? which : nullptr, stage.v);
    }
    // The length h of this step depends on the columns: it begins at a switch (dtau/dc in `passed`,
    // 0 where it began at none) and ends at a switch or at a time that stands still. y was computed
    // with h held, so
    //     dy/dc <- dy/dc + f(y) dh/dc ,
    //     dh/dc = -passed                          to a fixed end ,
    //     dh/dc = -(dg/dc) / (dg/dt)               to a switch g = 0 ,   passed <- passed + dh/dc .
    // The next step, under the new law, subtracts `passed` again times its own slope: together
    // (f_before - f_after) dtau/dc. `slopes` are f(y) under the old law.
    void move_instants(const Base &end, const int *which, const Base *slopes)
    {
        Base instant[MOST_COLUMNS + 1];
        for (int d = 0; d < columns; d++)
            instant[d] = -passed.d[d]; // the end stands still
        if (which)
            instants(end, which, slopes, instant);
        for (int s = 0; s < ns; s++)
            for (int d = 0; d < columns; d++)
                y.d[s * columns + d] += instant[d] * slopes[s];
        on_switch = false;
        for (int i = 0; i < W; i++) {
            bool switching = which && which[i] >= 0;
            lane[i].switched = switching ? lane[i].switched + 1 : 0;
            on_switch = on_switch || switching;
            for (int d = 0; d < columns; d++)
                put(passed.d[d], i, switching ? get(passed.d[d], i) + get(instant[d], i) : 0.0);
        }
    }
    // dh/dc by the implicit function theorem: g(y(h, c), c) = 0 for all c, so that
    //     dg/dc + (dg/dt) dh/dc = 0 ,   dg/dt = sum_s (dg/dx_s) f_s ,
    // with dg/dc the total derivative at a fixed h (chain). g does not depend on time by itself. A
    // grazing contact, dg/dt = 0, keeps the value for a fixed end.
    void instants(const Base &end, const int *which, const Base *slopes, Base *instant)
    {
        Scalar g[MK_MAX_EVENTS];
        look_at(y.v);
        mk::events(c, in_log(end), seen, g);
        for (int e = 0; e < c.event_count; e++) {
            bool wanted = false;
            for (int i = 0; i < W; i++)
                wanted = wanted || which[i] == e;
            if (!wanted)
                continue;
            Base rate = Base(0.0);
            Row row;
#if MK_DERIVATIVES
            Scalar::each(g[e].mask & ((1u << ns) - 1u),
                         [&](int s) { rate += g[e].d[s] * slopes[s]; });
#else
            (void)slopes;
#endif
            chain(g[e], y, row.d);
            for (int d = 0; d < columns; d++)
                for (int i = 0; i < W; i++)
                    if (which[i] == e && get(rate, i) != 0.0)
                        put(instant[d], i, -get(row.d[d], i) / get(rate, i));
        }
    }
    // Which law switches in which lane (-1: none) on the way over h to y; shortens h there to what
    // it takes to get just past it. False: nowhere. A switch is a change of sign of g_e between
    // both ends; of several the one that a straight line puts first. Two changes within one step
    // are not seen.
    bool find_switch(Base &h, const Base *y_end, int *which) const
    {
        Base ga[MK_MAX_EVENTS], gb[MK_MAX_EVENTS];
        bool any = false;
        mk::events(bare, in_log(now), x.v, ga);
        mk::events(bare, in_log(now + h), y_end, gb);
        for (int i = 0; i < W; i++) {
            which[i] = -1;
            double share = 1.0;
            if (!lane[i].task || lane[i].switched >= MOST_PARTS || get(h, i) < 10.0 * PAST)
                continue;
            for (int e = 0; e < c.event_count; e++) {
                // Share of h at which a straight line through both ends is 0.
                double va = get(ga[e], i), vb = get(gb[e], i);
                if ((va > 0.0) != (vb > 0.0) && va / (va - vb) <= share) {
                    share = va / (va - vb);
                    which[i] = e;
                }
            }
            any = any || which[i] >= 0;
        }
        if (!any)
            return false;
        Base a = pick(ga, which), b = pick(gb, which);
        // Root of g along the trajectory: from the straight line, three steps of the chord method,
        // whose slope stays that of the line,
        //     tau <- tau - g(x(tau)) / rate ,
        // each with a Runge-Kutta step from x of its own. Kept within (0, h).
        Base rate = (b - a) / h, guess = h * (a / (a - b));
        for (int round = 0; round < 3; round++) {
            Base at[MK_MAX_STATES], g[MK_MAX_EVENTS];
            bare_runge_kutta(guess, at);
            mk::events(bare, in_log(now + guess), at, g);
            guess -= pick(g, which) / rate;
            guess = if_positive(guess, guess, 1e-3 * h);
            guess = if_positive(h - guess, guess, 0.999 * h);
        }
        any = false;
        for (int i = 0; i < W; i++) {
            double length = get(guess, i) + PAST;
            if (!(which[i] >= 0 && length < get(h, i))) {
                which[i] = -1;
                continue;
            }
            put(h, i, length);
            any = true;
        }
        return any;
    }
    // By lane, one of the switching functions.
    static Base pick(const Base *g, const int *which)
    {
        Base r = g[0];
        for (int i = 0; i < W; i++)
            if (which[i] > 0)
                put(r, i, get(g[which[i]], i));
        return r;
    }

    // Takes what was read on the way and moves to y.
    void arrive(const Base &end)
    {
        // f(y) is needed for interpolation where readings lie within the step; else the next step
        // computes it anyway.
        slopes_known = readings_before(end);
        if (slopes_known) {
            derivative(end, y, f1);
            take_readings(end);
            move(f1, f0);
        }
        move(y, x);
        // A trajectory has run away where a state is beyond 1e6 or not a number.
        Base far = Base(0.0);
        for (int s = 0; s < ns; s++) {
            Base size = fabs(x.v[s]);
            far = if_positive(size - far, size, far);
            far += size - size; // not a number stays
        }
        if (!all_below(far, 1e6))
            for (int i = 0; i < W; i++)
                if (lane[i].task && !(get(far, i) < 1e6))
                    lane[i].task->finite = false;
        now = end;
        for (int i = 0; i < W; i++) {
            Lane &l = lane[i];
            l.now = get(end, i);
            if (l.task && l.switched == 0)
                l.step++;
        }
        turn();
    }
    void move(const Point &from, Point &to) const
    {
        for (int i = 0; i < ns; i++)
            to.v[i] = from.v[i];
        for (int i = 0; i < ns * columns; i++)
            to.d[i] = from.d[i];
    }

    // --- readings ---

    // Of the lanes whose next reading of a joint is before `end`: its row and time.
    struct Readings {
        long row[W]; // -1: none
        Base t;
        bool any;
    };
    Readings readings(int j, const Base &end, double slack)
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
    double time_of(const Lane &l, int j, long row) const
    {
        return l.task->data->t[row] - age[j];
    }
    bool pending(const Lane &l, int j, double end) const
    {
        const size_t rows = l.task->end_row ? l.task->end_row : l.task->data->rows;
        return l.next[j] < (long)rows && time_of(l, j, l.next[j]) < end;
    }
    bool readings_before(const Base &end) const
    {
        for (int i = 0; i < W; i++)
            for (int j = 0; j < c.joints && lane[i].task; j++)
                if (pending(lane[i], j, get(end, i) - 1e-9))
                    return true;
        return false;
    }
    // Readings that fall on the start of a step need no interpolation. Times are compared to within
    // 1e-9 s.
    void take_at_start()
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
    void compare_before(int j, const Readings &r)
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
    void take_readings(const Base &end)
    {
        for (int j = 0; j < c.joints; j++)
            for (Readings r; (r = readings(j, end, -1e-9)).any;)
                compare_within(j, r, end);
    }
    // Of lanes that have arrived.
    void take_up_to_end(int j)
    {
        Base end = Base(-NONE);
        for (int i = 0; i < W; i++)
            if (arrived(lane[i]) && lane[i].task->last && lane[i].task->finite)
                put(end, i, lane[i].task->end);
        for (Readings r; (r = readings(j, end, 1e-9)).any;)
            compare(j, r, x, f0.v);
    }
    void compare(int j, const Readings &r, const Point &at, const Base *rate)
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
    void compare_within(int j, const Readings &r, const Base &end)
    {
        Base h = end - now, inverse = 1.0 / if_positive(h, h, Base(1.0));
        Base s = (r.t - now) * inverse, left = 1.0 - s;
        Base h00 = (1.0 + 2.0 * s) * left * left, h10 = h * s * left * left,
             h01 = s * s * (3.0 - 2.0 * s), h11 = -h * s * s * left;
        Base g00 = -6.0 * s * left * inverse, g10 = left * (1.0 - 3.0 * s),
             g11 = s * (3.0 * s - 2.0);
        Base rate[MK_MAX_STATES];
        for (int i = 0; i < ns; i++) {
            between.v[i] = h00 * x.v[i] + h10 * f0.v[i] + h01 * y.v[i] + h11 * f1.v[i];
            rate[i] = g00 * x.v[i] + g10 * f0.v[i] - g00 * y.v[i] + g11 * f1.v[i];
        }
        compare_rows(j, r, between.v, rate, [&](int i) {
            for (int d = i * columns; d < (i + 1) * columns; d++)
                between.d[d] = h00 * x.d[d] + h10 * f0.d[d] + h01 * y.d[d] + h11 * f1.d[d];
            return between.d + i * columns;
        });
    }
    // Readings beside what the model reads in a state, whose derivatives are row_of(its number).
    template <class RowOf>
    // Residuals and their rows of J: with h_j what the model reads at joint j,
    //     r = w (y - h_j) ,   J = w dh_j/dc .
    // Readings without weight (missing ones) give no row. row_of(s) gives dx_s/dc.
    void compare_rows(int j, const Readings &r, const Base *at, const Base *rate, RowOf &&row_of)
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
    const Base *aged(int i, int j, const Base *young, const Base *rate)
    {
        for (int d = 0; d < columns; d++)
            older.d[i * columns + d] = young[d] - age_slope[j][d] * rate[i];
        return older.d + i * columns;
    }
    // Into a row of all columns: the states', then this pass's parameters. A kernel has room for
    // MOST_COLUMNS columns; further parameters take another pass (first_free).
    void store(const Base *d, int i, double w, double *row) const
    {
        for (int s = 0; s < columns; s++)
            row[s < ns ? s : first + s] = w * get(d[s], i);
    }
};

static int run(ShootTask *tasks, int count, int first_free)
{
    return with_plant(tasks->model->plant, [&](auto law) {
        Shooter<decltype(law)> shooter(tasks, count, first_free);
        shooter.run();
        return shooter.parameters_done();
    });
}

extern const ShootKernel shoot_kernel;
const ShootKernel shoot_kernel = {W, run};

} // namespace MK_KERNEL_NS
} // namespace mk

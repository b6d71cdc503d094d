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
// f is differentiated by what it sees, state and parameters (forward mode, model/sparse_dual.hpp);
// what the state itself depends on is carried along as columns X = dx/dc,
//     df/dc = (df/dx) X + df/dp dp/dc                                 (chain) ,
//     dX/dt = df/dc , X(0) = (1 0) .
// A task asks for one of two kinds. Exact ones are those of the numbers that the method computes,
// not of the exact solution (internal differentiation, H. G. Bock 1981): X takes the same
// Runge-Kutta stages as x, and belongs to the residuals exactly, at any step length. Close ones
// differentiate f once a step (sim/shoot_columns.hpp), which takes half the time.
//
// Where f is not smooth the instant tau of the change depends on the columns too, and a trajectory
// that changes its slope there from f_before to f_after gains
//     X <- X + (f_before - f_after) dtau/dc .
// This is done at edges of a command with a delay that is fitted (follow_edges), and where a law
// switches, as in contact (step_to_switch): tau then comes from the switching function g(x, p) = 0
// by the implicit function theorem.
//
// Shapes. A Point holds ns numbers x_i and, row-major, ns x columns derivatives X_ic, each a pack
// of W lanes. Columns 0 .. ns - 1 are the start state, the others free parameters from first_free
// on, each per scale[i] of its parameter. A kernel has room for MOST_COLUMNS of them; shoot() runs
// it again for parameters that are left. Times are in s from the first row of the task's data; a
// reading less than 1e-9 s from the end of a step counts as at it.
//
// Every interval has a lane of its own: it goes at its own pace, with its own steps, and when it
// arrives the next one takes its place. What comes out does not depend on who travels beside it.
//
// sim/shoot_lanes.hpp has the lanes, shoot_columns.hpp the derivatives of a step,
// shoot_switches.hpp the steps that end at a switch, shoot_readings.hpp what is compared on the
// way, and shoot_normal.hpp its normal equations.
#include "model/rhs.hpp"
#include "sim/shoot.hpp"
#include "sim/shoot_lanes.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

template <class Law>
class Shooter
{
  public:
    // Derivatives by the start state and by free parameters first_free ... of as many as there is
    // room for: `columns` in all.
    // All tasks share model, step, columns and free parameters (tasks[0] has them). Lanes begin
    // idle, with zeros, since every lane is computed whether it is in use or not.
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
        for (int i = 0; i < ns * ns; i++)
            linear.unity[i] = Base(i % (ns + 1) == 0 ? 1.0 : 0.0);
        u[0] = u[1] = now = start = Base(0.0);
    }
    // Free parameters that this run differentiates by.
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
                slopes_at(now, x, f0);
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
    Linear linear; // of a step, for close derivatives
    Base u[MK_MAX_INPUTS], now;
    Base start;                       // of each lane's rows in their log, s
    Scalar seen[MK_MAX_STATES];       // the state as laws see it
    Scalar seen_slope[MK_MAX_STATES]; // its slope, as derivative() leaves it
    Base before[MK_MAX_STATES];       // slopes under the last command
    Row passed;                       // of the start of a step at an instant where a law switched
    double late = 0.0;                // delay of the command
    double age[MK_MAX_JOINTS] = {};   // of each joint's readings
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
    // `slope` is d parameter / d column. Without derivatives nothing happens.
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
    // Delays add up: late = sum of the command's delays, age[j] = sum of those of joint j's sensor
    // (joint -1: of all joints). Their derivatives by a column are the sums of the parameters'
    // slopes. Only a delay that is fitted moves edges or ages.
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
    // The lane starts at its task's begin with x = x_0, X = (1 0) and the command that is in force
    // there. l.next is the first reading of each joint: from the task's rows where it names them,
    // else the first one that shows a state at or after the begin. Without a waiting task the lane
    // is idle.
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
    // By bisection: t is sorted. d.rows where there is none.
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
    // Lanes whose interval has ended, or whose trajectory ran away, hand in what they found; the
    // next tasks take their places. Whether any did.
    // x_end and jac_end are written in any case: of a trajectory that ran away they are where it
    // was then.
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

    // `row` is -1 before the first one. The command is held until the next edge.
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
    // A command that repeats itself is no edge: its row is passed over, but no further than k.step,
    // since a step ends at least that often. The row may be one behind the last: there is no
    // further edge.
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
    // Time at which it begins to act, s; NONE where there is no further one.
    double next_edge(const Lane &l) const
    {
        const ShootData &d = *l.task->data;
        const long row = next_command(l);
        return row < (long)d.rows ? d.t[row] + late : NONE;
    }
    // Commands whose time has come take over.
    // With moving edges the slopes under the old command are kept in `before` (follow_edges).
    // Several edges at one instant take over in their order; the last one stays.
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
        if (exact())
            derivative(now, x, f0);
    }

    // --- steps ---

    // Whether derivatives are those of the Runge-Kutta stages.
    bool exact() const
    {
        return MK_DERIVATIVES && !k.close;
    }
    // f at a state; with df/dc where that goes through the stages.
    void slopes_at(const Base &t, const Point &at, Point &f)
    {
        if (exact())
            derivative(t, at, f);
        else
            bare_slopes(t, at.v, f.v);
    }

    // f and df/dc at a state.
    void derivative(const Base &t, const Point &at, Point &f)
    {
        look_at(at.v);
        rhs_of<Law>(c, in_log(t), seen, u, seen_slope);
        for (int i = 0; i < ns; i++) {
            f.v[i] = base_of(seen_slope[i]);
            chain(seen_slope[i], at, f.d + i * columns);
        }
    }
    void bare_slopes(const Base &t, const Base *at, Base *dx) const
    {
        rhs_of<Law>(bare, in_log(t), at, u, dx);
    }
    // The state as laws see it: values v, and slope 1 by itself (set once, in seed()). Whatever is
    // computed from `seen` next has its derivatives by the state in columns 0 .. ns - 1, for
    // chain().
    void look_at(const Base *v)
    {
        for (int i = 0; i < ns; i++)
#if MK_DERIVATIVES
            seen[i].v = v[i];
#else
            seen[i] = v[i];
#endif
    }
    // row = sum_i by[i] from[i] of N terms, over `count` columns. Factors and addresses stay in
    // registers: for all that the compiler knows, writing the row could change them.
    template <int N>
    static void weigh(const Base *by, const Base *const *from, int count, Base *row)
    {
        Base factor[N];
        const Base *of[N];
        for (int i = 0; i < N; i++)
            factor[i] = by[i], of[i] = from[i];
        for (int d = 0; d < count; d++) {
            Base sum = factor[0] * of[0][d];
#pragma GCC unroll 8
            for (int i = 1; i < N; i++)
                sum += factor[i] * of[i][d];
            row[d] = sum;
        }
    }
    // The same of n terms.
    static void weigh_many(int n, const Base *by, const Base *const *from, int count, Base *row)
    {
        for (int d = 0; d < count; d++) {
            Base sum = Base(0.0);
            for (int i = 0; i < n; i++)
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
        weigh_states(number, row_of, columns, row);
        // What depends on a parameter directly, beside what the state carries of it.
        Scalar::each(number.mask & ~states_mask(), [&](int d) { row[d] += number.d[d]; });
#else
        (void)number, (void)row_of, (void)row;
#endif
    }
    // Bits of the states among the columns.
    uint32_t states_mask() const
    {
        return (1u << ns) - 1u;
    }
#if MK_DERIVATIVES
    // sum_s (d number/dx_s) row_of(s), over `count` columns.
    template <class RowOf>
    void weigh_states(const Scalar &number, RowOf &&row_of, int count, Base *row) const
    {
        // The n states that the number depends on: their rows (`from`) and d number/dx_s (`by`).
        int n = 0;
        const Base *from[MK_MAX_STATES];
        Base by[MK_MAX_STATES];
        Scalar::each(number.mask & states_mask(), [&](int s) {
            from[n] = row_of(s);
            by[n++] = number.d[s];
        });
        weigh_all(n, by, from, count, row);
    }
#endif
    static void weigh_all(int n, const Base *by, const Base *const *from, int count, Base *row)
    {
        switch (n) {
        case 1:
            return weigh<1>(by, from, count, row);
        case 2:
            return weigh<2>(by, from, count, row);
        case 3:
            return weigh<3>(by, from, count, row);
        case 4:
            return weigh<4>(by, from, count, row);
        case 5:
            return weigh<5>(by, from, count, row);
        case 6:
            return weigh<6>(by, from, count, row);
        default:
            return weigh_many(n, by, from, count, row);
        }
    }
    // Where each lane's step shall end.
    // A lane that is within a step that a switch has cut (switched > 0) keeps its target: the rest
    // of that step is still to be gone. Runs of length 0 have no steps and are passed over.
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
    // Steps are l.from + h, l.from + 2 h ... so that rounding does not add up.
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
    // `place` in the state.
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
    void runge_kutta(const Base &h)
    {
        if (exact())
            exact_runge_kutta(h);
        else
            close_runge_kutta(h);
    }
    // Without derivatives, to look ahead.
    void bare_runge_kutta(const Base &h, Base *to) const
    {
        stages(h, to, [this](const Base &t, const Base *at, Base *f) { bare_slopes(t, at, f); });
    }
    // `third` evaluates f in the third stage, whose state is that of the middle to third order.
    template <class Third>
    void stages(const Base &h, Base *to, Third &&third) const
    {
        const Base half = 0.5 * h, mid = now + half;
        Base k2[MK_MAX_STATES], k3[MK_MAX_STATES], k4[MK_MAX_STATES];
        for (int i = 0; i < ns; i++)
            to[i] = x.v[i] + half * f0.v[i];
        bare_slopes(mid, to, k2);
        for (int i = 0; i < ns; i++)
            to[i] = x.v[i] + half * k2[i];
        third(mid, to, k3);
        for (int i = 0; i < ns; i++)
            to[i] = x.v[i] + h * k3[i];
        bare_slopes(now + h, to, k4);
        for (int i = 0; i < ns; i++)
            to[i] = x.v[i] + (1.0 / 6.0) * h * (f0.v[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
    }
    // sim/shoot_columns.hpp
    void exact_runge_kutta(const Base &h);
    void first_stage(const Base &h);
    void next_stage(const Base &h, const Point &sum);
    void close_runge_kutta(const Base &h);
    void linearise(const Base &t, const Base *at, Base *f);
    void move_columns(const Base &h);
    void brackets(const Base &h, const Base *V, int count, Base *out) const;
    void slope_row(int i, const Point &at, Point &out) const;

    // Of the lanes in `who`; NULL: of all that are in use.
    void count_steps(const bool *who)
    {
        for (int i = 0; i < W; i++)
            if (lane[i].task && (!who || who[i]))
                lane[i].task->steps++;
    }

    // One step of every lane from `now` to its target, or to just past the first switch within it.
    // `end` then has the times that were reached, and y the states there.
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

    // Parts of a step that end where a law switches (sim/shoot_switches.hpp).
    void step_to_switch(Base &end);
    void move_instants(const Base &end, const int *which, const Base *slopes);
    void instants(const Base &end, const int *which, const Base *slopes, Base *instant);
    bool find_switch(Base &h, const Base *y_end, int *which) const;
    static Base pick(const Base *g, const int *which);

    // Takes what was read on the way and moves to y.
    void arrive(const Base &end)
    {
        // f(y) is needed for interpolation where readings lie within the step; else the next step
        // computes it anyway.
        slopes_known = readings_before(end);
        if (slopes_known) {
            slopes_at(end, y, f1);
            take_readings(end);
            if (exact())
                move(f1, f0);
            for (int i = 0; i < ns; i++)
                f0.v[i] = f1.v[i];
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
    // The numbers in use; a Point has room for more.
    void move(const Point &from, Point &to) const
    {
        for (int i = 0; i < ns; i++)
            to.v[i] = from.v[i];
        for (int i = 0; i < ns * columns; i++)
            to.d[i] = from.d[i];
    }

    // --- readings (sim/shoot_readings.hpp) ---

    // Of the lanes whose next reading of a joint is before `end`: its row and time.
    struct Readings {
        long row[W]; // -1: none
        Base t;
        bool any;
    };
    // Takes them: a reading that was given is not given again. At most one a lane, so that it is
    // called until none is left.
    Readings readings(int j, const Base &end, double slack);
    double time_of(const Lane &l, int j, long row) const;
    bool pending(const Lane &l, int j, double end) const;
    bool readings_before(const Base &end) const;
    void take_at_start();
    void compare_before(int j, const Readings &r);
    void take_readings(const Base &end);
    void take_up_to_end(int j);
    void compare(int j, const Readings &r, const Point &at, const Base *rate);
    void compare_within(int j, const Readings &r, const Base &end);
    template <class RowOf>
    void compare_rows(int j, const Readings &r, const Base *at, const Base *rate, RowOf &&row_of);
    const Base *aged(int i, int j, const Base *young, const Base *rate);
    void store(const Base *d, int i, double w, double *row) const;
};

} // namespace MK_KERNEL_NS
} // namespace mk

#include "sim/shoot_columns.hpp"
#include "sim/shoot_normal.hpp"
#include "sim/shoot_readings.hpp"
#include "sim/shoot_switches.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

// Chooses the plant's equations at compile time, so that they are inlined. Returns how many of the
// free parameters from first_free on were differentiated by.
static int run(ShootTask *tasks, int count, int first_free)
{
    return with_plant(tasks->model->plant, [&](auto law) {
        Shooter<decltype(law)> shooter(tasks, count, first_free);
        shooter.run();
        return shooter.parameters_done();
    });
}

extern const ShootKernel shoot_kernel;
#if MK_DERIVATIVES && MK_WIDTH > 1
const ShootKernel shoot_kernel = {W, run, gram};
#else
const ShootKernel shoot_kernel = {W, run, nullptr};
#endif

} // namespace MK_KERNEL_NS
} // namespace mk

// Free runs of a window: least squares over its own readings (sim/window_fit.hpp).
//
// The start state x of a window minimises
//     S(x) = |r(x)|^2 + (z - z0)' K (z - z0) ,   r_k = w_k (y_k - h(x(t_k))) ,
// with z the part of x that belongs to effects, z0 what is known of it beforehand (`expected`, or
// where the search begins) and K = diag(1 / s^2) how well (`known`). Angles and speeds have no such
// term: the readings of the window say them. With J = w dh/d(x, p), columns Js of the
// start state and Jp of the parameters:
//     H = Js'Js + K ,   g = Js'r + K (z0 - z) ,   S(x + d) ~ S - 2 g'd + d'H d .
// S has no factor 1/2.
//
// The method is Levenberg and Marquardt's (D. Marquardt 1963), on longer and longer beginnings of
// the window: over a short one the trajectory is nearly linear in its start state, and its optimum
// is where the next one starts (a progressive horizon). Several windows of one model go side by
// side through the kernel; each is a state machine (Progress) that proposes the next trajectory and
// takes what came of it.
//
// linearise() then eliminates the start state, so that what is left is a quadratic in the
// parameters.
#include "sim/window_fit.hpp"
#include "base/dense.hpp"

#include <algorithm>
#include <cmath>

using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace mk
{

namespace
{

// Standard deviation s of an effect's state about z0 where nothing better is known, as of a joint's
// far side: rad, rad/s.
constexpr double HIDDEN_STD = 0.05;
// Of other states of effects, over what they usually vary by: what a run through the readings
// before the window leaves open.
constexpr double KNOWN = 0.01;
// Time constant, s, with which a state at the start of the log stops to matter.
constexpr double FORGOTTEN = 0.5;
// First horizon, s, and the factor from one to the next.
constexpr double FIRST_HORIZON = 0.05;
constexpr double LONGER = 2.0;
// Least rows of a horizon.
constexpr size_t FEWEST_READINGS = 12;
// Relative decrease of S below which a horizon is done, and below which the whole window is.
constexpr double SETTLED_ROUGHLY = 1e-2;
constexpr double SETTLED = 1e-7;
// Steps at most of one horizon; and where the start is near.
constexpr int MOST_STEPS = 25, SOME_STEPS = 6;
// Levenberg's damping, relative to the diagonal of H, and its factors after a step that was taken
// and one that was not.
constexpr double FIRST_DAMPING = 1e-4, LEAST_DAMPING = 1e-9, MOST_DAMPING = 1e6;
constexpr double EASIER = 0.1, HARDER = 10.0;

} // namespace

// |r|^2, in counts^2 where the weights are 1 / count (basic_finder). Infinite where the run has
// none.
static double squares_of(const ShootTask &task)
{
    const double squares =
        Eigen::Map<const VectorXd>(task.residual, (long)task.row_count).squaredNorm();
    return task.finite && std::isfinite(squares) ? squares : HUGE_VAL;
}

// Where the readings begin that lead to a row.
static size_t begin_of(const mk_start_finder &f, size_t row)
{
    return f.way && !f.way->row.empty() ? f.way->begin[f.way->place_before(row)] : 0;
}

// Buffers hold all readings of the window and no derivatives by parameters; differentiate_by()
// makes room for those. `finder` must outlive the fit.
WindowFit::WindowFit(const mk_start_finder &finder, size_t from_row, size_t to_row)
    : f(finder), ns(mk_model_state_count(finder.model)), from(from_row), to(to_row)
{
    const size_t capacity = MK_MAX_JOINTS * (to - from);
    residual.resize(capacity);
    jac.resize(capacity * (size_t)ns);
    x_end.resize((size_t)ns);
    jac_end.resize((size_t)(ns * ns));
    // K = 1 / s^2. With the finder's usual variation u of a state (Memory) and T the length of
    // the readings that lead to the window,
    //     s = (KNOWN + exp(-T / FORGOTTEN)) u .
    // The exponential is the doubt of where the effect was before the log. However large it is, a
    // state is not free to be anywhere: one that is makes up for whatever the model misses at the
    // start.
    known = VectorXd::Constant(ns, 1.0 / (HIDDEN_STD * HIDDEN_STD));
    const VectorXd &usual = f.memory.usual;
    for (long s = 0; s < usual.size(); s++) {
        const double run_up = f.t[from] - f.t[begin_of(f, from)];
        const double unknown = KNOWN + std::exp(-run_up / FORGOTTEN);
        known(ns - usual.size() + s) = std::pow(unknown * usual(s), -2);
    }
}

// Columns are then the ns start states and the parameters in their order, each per its unit.
void WindowFit::differentiate_by(const std::vector<int> &parameters,
                                 const std::vector<double> &units)
{
    free = &parameters, unit = &units;
    const size_t columns = (size_t)ns + parameters.size();
    jac.resize(residual.size() * columns);
    jac_end.resize((size_t)ns * columns);
}

// The state machine for one window: shoot what it proposes, and tell it, until it is done. x is the
// optimum of the longest horizon that could be run, which is the window but where the model runs
// away.
bool WindowFit::solve(VectorXd &x)
{
    Progress p = begin(x);
    while (p.running) {
        ShootTask task = task_over(p.trial, p.last, ns);
        shoot(task);
        take(task, p);
    }
    x = p.best;
    return p.any;
}

std::vector<char> WindowFit::solve(std::vector<WindowFit> &fits, std::vector<VectorXd> &x)
{
    std::vector<Progress> all;
    for (size_t i = 0; i < fits.size(); i++)
        all.push_back(fits[i].begin(x[i]));
    return solve_all(fits, all, x);
}

// An infinite horizon is the whole window from the first step on. `rough` ends with a decrease
// below SETTLED_ROUGHLY, or after SOME_STEPS.
std::vector<char> WindowFit::solve_near(std::vector<WindowFit> &fits, std::vector<VectorXd> &x,
                                        Care care)
{
    std::vector<Progress> all;
    for (size_t i = 0; i < fits.size(); i++) {
        Progress p = fits[i].begin(x[i]);
        p.horizon = HUGE_VAL;
        if (care == Care::rough) {
            p.settled = SETTLED_ROUGHLY;
            p.most_steps = SOME_STEPS;
        }
        fits[i].begin_horizon(p);
        all.push_back(std::move(p));
    }
    return solve_all(fits, all, x);
}

// One turn shoots the proposals of all windows that are not done in one call of the kernel, which
// fills its lanes with them. Windows that are done drop out. fits[i], all[i] and x[i] belong
// together; a task's buffers are those of its fit.
std::vector<char> WindowFit::solve_all(std::vector<WindowFit> &fits, std::vector<Progress> &all,
                                       std::vector<VectorXd> &x)
{
    std::vector<ShootTask> tasks;
    std::vector<size_t> of;
    for (;;) {
        tasks.clear();
        of.clear();
        for (size_t i = 0; i < fits.size(); i++)
            if (all[i].running) {
                tasks.push_back(fits[i].task_over(all[i].trial, all[i].last, fits[i].ns));
                of.push_back(i);
            }
        if (tasks.empty())
            break;
        shoot(tasks.data(), (int)tasks.size());
        for (size_t k = 0; k < tasks.size(); k++)
            fits[of[k]].take(tasks[k], all[of[k]]);
    }
    std::vector<char> solved;
    for (size_t i = 0; i < fits.size(); i++) {
        x[i] = all[i].best;
        solved.push_back(all[i].any);
    }
    return solved;
}

// What holds between two calls of take(): `trial` is what is shot next; `now` are the normal
// equations about `at`, the best state of this horizon, once `begun`; `best` is the optimum of the
// last horizon that is done, `any` that there is one.
WindowFit::Progress WindowFit::begin(const VectorXd &x) const
{
    Progress p = {};
    // z0 is `expected`, where it was given, else where the search begins.
    p.begun_at = p.best = x;
    p.begun_at.tail(expected.size()) = expected;
    p.horizon = FIRST_HORIZON;
    p.settled = SETTLED;
    p.most_steps = MOST_STEPS;
    p.running = true;
    begin_horizon(p);
    return p;
}

void WindowFit::begin_horizon(Progress &p) const
{
    // Rows of the horizon: those within p.horizon of the start, FEWEST_READINGS at least.
    p.whole = p.horizon >= f.t[to - 1] - f.t[from];
    p.last = to;
    while (!p.whole && p.last > from + FEWEST_READINGS && f.t[p.last - 1] - f.t[from] > p.horizon)
        p.last--;
    // Every horizon begins with next to no damping, from the optimum of the shorter one.
    p.trial = p.best;
    p.damping = FIRST_DAMPING;
    p.steps = 0;
    p.begun = false;
}

// The optimum of this horizon is where the next one starts, twice as long; behind the whole window
// there is none.
void WindowFit::end_horizon(Progress &p) const
{
    p.best = p.at;
    p.any = true;
    p.running = !p.whole;
    p.horizon *= LONGER;
    if (p.running)
        begin_horizon(p);
}

// Levenberg and Marquardt: the next trial is x + d with (H + lambda diag H) d = g. 1e-9 keeps
// angles and speeds that no reading sees where they are. Ends the horizon where the step promises
// next to nothing, and where damping or steps are used up.
void WindowFit::propose(Progress &p) const
{
    const long joints = mk_model_joints(f.model);
    for (; p.steps < p.most_steps && p.damping < MOST_DAMPING; p.steps++) {
        MatrixXd damped = p.now.H;
        damped.diagonal() *= 1.0 + p.damping;
        damped.diagonal().head(2 * joints).array() += 1e-9;
        const VectorXd d = dense::solve_symmetric(damped, p.now.g);
        // What the quadratic promises of the step: 2 g'd - d'H d.
        const double decrease = 2.0 * p.now.g.dot(d) - d.dot(p.now.H * d);
        if (decrease <= settled_below(p))
            break;
        p.trial = p.at + d;
        if (p.trial.allFinite())
            return;
        p.damping *= HARDER;
    }
    end_horizon(p);
}

// The decrease of S that is not worth a step.
double WindowFit::settled_below(const Progress &p)
{
    return (p.whole ? p.settled : SETTLED_ROUGHLY) * p.now.squares;
}

// What the trajectory from p.trial says. The first one of a horizon is its start; later ones are
// taken where S has not risen. Small decreases end the horizon.
// A horizon that cannot be run from where the shorter one ended ends the search, with that one's
// optimum.
void WindowFit::take(const ShootTask &task, Progress &p) const
{
    WindowNormal there;
    const bool fine = normal_of(task, there);
    if (fine)
        add_known(p, there);
    if (!p.begun) {
        p.running = fine;
        p.begun = true;
        p.at = p.trial;
        p.now = std::move(there);
        if (fine)
            propose(p);
        return;
    }
    p.steps++;
    if (!fine || !(there.squares <= p.now.squares)) {
        p.damping *= HARDER;
        propose(p);
        return;
    }
    const bool done = p.now.squares - there.squares <= settled_below(p);
    p.at = p.trial;
    p.now = std::move(there);
    p.damping = std::max(EASIER * p.damping, LEAST_DAMPING);
    if (done)
        end_horizon(p);
    else
        propose(p);
}

// The term of z in S: H += K, g += K (z0 - z), S += (z0 - z)' K (z0 - z).
void WindowFit::add_known(const Progress &p, WindowNormal &out) const
{
    for (long s = 2 * mk_model_joints(f.model); s < ns; s++) {
        const double off = p.begun_at(s) - p.trial(s);
        out.H(s, s) += known(s);
        out.g(s) += off * known(s);
        out.squares += off * off * known(s);
    }
}

// |r|^2 alone, without the term of z, and without derivatives.
double WindowFit::cost(const VectorXd &x)
{
    ShootTask task = task_over(x, to, 0);
    shoot(task);
    return squares_of(task);
}

std::vector<double> WindowFit::costs(std::vector<WindowFit> &fits, const std::vector<VectorXd> &x)
{
    std::vector<ShootTask> tasks;
    for (size_t i = 0; i < fits.size(); i++)
        tasks.push_back(fits[i].task_over(x[i], fits[i].to, 0));
    shoot(tasks.data(), (int)tasks.size());
    std::vector<double> squares;
    for (const ShootTask &task : tasks)
        squares.push_back(squares_of(task));
    return squares;
}

// `q` has as many rows as the record; only those of the windows are written.
std::vector<char> WindowFit::angles(std::vector<WindowFit> &fits, const std::vector<VectorXd> &x,
                                    double *const q[MK_MAX_JOINTS])
{
    std::vector<ShootTask> tasks;
    for (size_t i = 0; i < fits.size(); i++) {
        WindowFit &fit = fits[i];
        fit.joint.resize(fit.residual.size());
        tasks.push_back(fit.task_over(x[i], fit.to, 0));
        tasks.back().joint_of = fit.joint.data();
    }
    shoot(tasks.data(), (int)tasks.size());
    std::vector<char> fine;
    for (size_t i = 0; i < fits.size(); i++) {
        fits[i].angles_of(tasks[i], q);
        fine.push_back(tasks[i].finite);
    }
    return fine;
}

// The residuals of each joint come row by row: h(x(t_k)) = y_k - r_k / w_k .
void WindowFit::angles_of(const ShootTask &task, double *const q[MK_MAX_JOINTS]) const
{
    size_t row[MK_MAX_JOINTS] = {from, from};
    for (size_t i = 0; i < task.row_count; i++) {
        const int j = task.joint_of[i];
        size_t &k = row[j];
        while (k < to && !(f.data.w[j][k] > 0.0))
            k++;
        if (k < to && std::isfinite(task.residual[i]))
            q[j][k] = f.data.q[j][k] - task.residual[i] / f.data.w[j][k];
        k++;
    }
}

// H = J'J + K, but g and squares are those of the readings: x is taken to be where z is expected.
std::vector<char> WindowFit::normals_at(std::vector<WindowFit> &fits,
                                        const std::vector<VectorXd> &x,
                                        std::vector<WindowNormal> &out)
{
    std::vector<ShootTask> tasks;
    for (size_t i = 0; i < fits.size(); i++) {
        const int parameters = fits[i].free ? (int)fits[i].free->size() : 0;
        tasks.push_back(fits[i].task_over(x[i], fits[i].to, fits[i].ns + parameters));
    }
    shoot(tasks.data(), (int)tasks.size());
    out.resize(fits.size());
    std::vector<char> fine;
    for (size_t i = 0; i < fits.size(); i++) {
        fine.push_back(fits[i].normal_of(tasks[i], out[i]));
        for (long s = 2 * mk_model_joints(fits[i].f.model); fine[i] && s < fits[i].ns; s++)
            out[i].H(s, s) += fits[i].known(s);
    }
    return fine;
}

// The state at a row, by the model alone: readings are not looked at.
// x is left as it was where the model runs away.
bool WindowFit::carry(VectorXd &x, size_t row)
{
    ShootTask task = task_from(x, f.t[row], 0);
    task.row_capacity = 0;
    shoot(task);
    if (!task.finite)
        return false;
    x = Eigen::Map<VectorXd>(x_end.data(), ns);
    return true;
}

// Up to the last reading of the horizon, and all of its readings.
ShootTask WindowFit::task_over(const VectorXd &x, size_t last, int columns)
{
    ShootTask task = task_from(x, f.t[last - 1], columns);
    task.first_row = from;
    task.end_row = last;
    return task;
}

// J'J, J'r and r'r of the readings that the trajectory has met.
// J is rows x columns (start states, then parameters), with the readings that count. gram() makes
// J'J by the widest instructions of the machine.
bool WindowFit::normal_of(const ShootTask &task, WindowNormal &out) const
{
    if (!task.finite)
        return false;
    const long n = (long)task.row_count;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<const RowMajor> J(task.jac, n, task.columns);
    Eigen::Map<const VectorXd> r(task.residual, n);
    out.H.resize(task.columns, task.columns);
    gram({task.jac, n, task.columns, nullptr, 0}, out.H.data());
    out.g = J.transpose() * r;
    out.squares = r.squaredNorm();
    out.readings = task.row_count;
    return std::isfinite(out.squares);
}

// out[i] is of fits[i]; not finite where the model runs away.
void WindowFit::linearise(std::vector<WindowFit> &fits, const std::vector<VectorXd> &x,
                          std::vector<WindowQuadratic> &out)
{
    std::vector<ShootTask> tasks;
    for (size_t i = 0; i < fits.size(); i++) {
        WindowFit &fit = fits[i];
        fit.joint.resize(fit.residual.size());
        tasks.push_back(fit.task_over(x[i], fit.to, fit.ns + (int)fit.free->size()));
        tasks.back().joint_of = fit.joint.data();
    }
    shoot(tasks.data(), (int)tasks.size());
    out.resize(fits.size());
    for (size_t i = 0; i < fits.size(); i++)
        fits[i].quadratic_of(tasks[i], out[i]);
}

// Elimination of the start state. A step d of the parameters leaves r - Js a - Jp d of the
// readings, a the step of the start state, and S is least over a where
//     a = shift - follow d ,
//     shift  = (Js'Js + K)^-1 (Js'r + K (z0 - z)) ,
//     follow = (Js'Js + K)^-1 (Js'Jp - K dz0/dp) ,
// since what is known of hidden states comes from a run of the model, z0(p).
// Put in,
//     rest - left d ,   rest = r - Js shift ,   left = Jp - Js follow ,
// and of each joint's rows the quadratic is
//     S_j(d) = squares - 2 g'd + d'H d ,
//     H = left'left ,   g = left'rest ,   squares = rest'rest .
// All joints share one a, that of their common least squares. `before` is |r|^2 of the joint, from
// the start state as it was. The term of z is not in S_j: it is no error of the readings.
void WindowFit::quadratic_of(const ShootTask &task, WindowQuadratic &out) const
{
    // States that the readings say nothing about stay: relative and absolute part of the diagonal.
    constexpr double TRACE = 1e-9;
    out.finite = task.finite;
    if (!task.finite)
        return;
    // Shapes: Js is n x ns, Jp n x p, r n; states ns x ns, both and solved ns x (p + 1).
    const long n = (long)task.row_count, p = task.columns - ns;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<const RowMajor> J(task.jac, n, task.columns);
    Eigen::Map<const VectorXd> r(task.residual, n);
    // states = Js'Js + K, pull = K (z0 - z); both = [Js'Jp, Js'r + pull].
    MatrixXd normal(task.columns, task.columns);
    gram({task.jac, n, task.columns, nullptr, 0}, normal.data());
    MatrixXd states = normal.topLeftCorner(ns, ns);
    states.diagonal() *= 1.0 + TRACE;
    states.diagonal().array() += TRACE;
    for (long s = 2 * mk_model_joints(f.model); s < ns; s++)
        states(s, s) += known(s);
    MatrixXd both(ns, p + 1);
    both << normal.topRightCorner(ns, p), J.leftCols(ns).transpose() * r;
    if (expected.size() > 0)
        both.col(p).tail(expected.size()) +=
            known.tail(expected.size())
                .cwiseProduct(expected -
                              Eigen::Map<const VectorXd>(task.x, ns).tail(expected.size()));
    if (expected_slope.size() > 0)
        both.leftCols(p).bottomRows(expected_slope.rows()) -=
            known.tail(expected_slope.rows()).asDiagonal() * expected_slope;
    // One decomposition for all p + 1 right-hand sides.
    const MatrixXd solved = dense::solve_symmetric(states, both);
    out.follow = solved.leftCols(p);
    out.shift = solved.col(p);
    // [left rest] = [Jp r] - Js [follow shift], and its products joint by joint.
    RowMajor left(n, p + 1);
    left << J.rightCols(p), r;
    left -= J.leftCols(ns).lazyProduct(solved);
    MatrixXd product(p + 1, p + 1);
    for (int j = 0; j < mk_model_joints(f.model); j++) {
        out.before[j] = 0.0;
        out.readings[j] = 0;
        for (long i = 0; i < n; i++)
            if (task.joint_of[i] == j) {
                out.before[j] += r(i) * r(i);
                out.readings[j]++;
            }
        gram({left.data(), n, (int)p + 1, task.joint_of, j}, product.data());
        out.H[j] = product.topLeftCorner(p, p);
        out.g[j] = product.col(p).head(p);
        out.squares[j] = product(p, p);
    }
    out.finite = left.allFinite();
}

ShootTask task_of(const mk_start_finder &f, const double *x, size_t from, double end)
{
    ShootTask task = {};
    task.model = f.model;
    task.data = &f.data;
    task.begin = f.t[from];
    task.end = end;
    task.x = x;
    task.step = f.step;
    task.edges_differ = f.edges_differ;
    return task;
}

// What all runs of a window share: from x at its first row to `end`, `last` so that a reading at
// `end` counts. Results go to the fit's buffers, which the next task of this fit overwrites.
// `columns` is ns + the number of parameters, ns, or 0; jac_end is there but not used. A start
// state alone is found with close derivatives; what a window says of parameters takes exact ones.
ShootTask WindowFit::task_from(const VectorXd &x, double end, int columns)
{
    ShootTask task = task_of(f, x.data(), from, end);
    task.last = true;
    task.columns = columns;
    task.close = columns == ns;
    task.free_count = std::max(columns - ns, 0);
    task.free = task.free_count ? free->data() : nullptr;
    task.scale = task.free_count ? unit->data() : nullptr;
    task.x_end = x_end.data();
    task.jac_end = jac_end.data();
    task.row_capacity = residual.size();
    task.residual = residual.data();
    task.jac = jac.data();
    return task;
}

} // namespace mk

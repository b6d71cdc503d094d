// Free runs of a window: least squares over its own readings.
//
// Levenberg and Marquardt's method with exact derivatives, on longer and longer beginnings of the
// window: over a short one the trajectory is nearly linear in its start state, and its optimum is
// where the next one starts (a progressive horizon).
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

constexpr double HIDDEN_STD = 0.05;      // s above: of effects' states after the run up to them
constexpr double STEP = 2.5e-3;          // longest integration step, s
constexpr double FIRST_HORIZON = 0.05;   // s
constexpr double LONGER = 2.0;           // from one horizon to the next
constexpr size_t FEWEST_READINGS = 12;   // rows of a horizon
constexpr double SETTLED_ROUGHLY = 1e-2; // relative decrease at which a horizon is done,
constexpr double SETTLED = 1e-7;         // and the whole window
constexpr int MOST_STEPS = 25;
constexpr double FIRST_DAMPING = 1e-4, LEAST_DAMPING = 1e-9, MOST_DAMPING = 1e6;
constexpr double EASIER = 0.1, HARDER = 10.0;

} // namespace

WindowFit::WindowFit(const mk_start_finder &finder, size_t from_row, size_t to_row)
    : f(finder), ns(mk_model_state_count(finder.model)), from(from_row), to(to_row)
{
    const size_t capacity = MK_MAX_JOINTS * (to - from) + 64;
    residual.resize(capacity);
    jac.resize(capacity * (size_t)ns);
    x_end.resize((size_t)ns);
    jac_end.resize((size_t)(ns * ns));
}

void WindowFit::differentiate_by(const std::vector<int> &parameters,
                                 const std::vector<double> &units)
{
    free = &parameters, unit = &units;
    const size_t columns = (size_t)ns + parameters.size();
    jac.resize(residual.size() * columns);
    jac_end.resize((size_t)ns * columns);
}

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

WindowFit::Progress WindowFit::begin(const VectorXd &x) const
{
    Progress p = {};
    p.known = p.best = x;
    p.horizon = FIRST_HORIZON;
    p.running = true;
    begin_horizon(p);
    return p;
}

void WindowFit::begin_horizon(Progress &p) const
{
    p.whole = p.horizon >= f.t[to - 1] - f.t[from];
    p.last = to;
    while (!p.whole && p.last > from + FEWEST_READINGS && f.t[p.last - 1] - f.t[from] > p.horizon)
        p.last--;
    p.trial = p.best;
    p.damping = FIRST_DAMPING;
    p.steps = 0;
    p.begun = false;
}

void WindowFit::end_horizon(Progress &p) const
{
    p.best = p.at;
    p.any = true;
    p.running = !p.whole;
    p.horizon *= LONGER;
    if (p.running)
        begin_horizon(p);
}

// Levenberg and Marquardt: the next trial is x + d with (H + l diag H) d = g.
void WindowFit::propose(Progress &p) const
{
    const long joints = mk_model_joints(f.model);
    for (; p.steps < MOST_STEPS && p.damping < MOST_DAMPING; p.steps++) {
        MatrixXd damped = p.now.H;
        damped.diagonal() *= 1.0 + p.damping;
        damped.diagonal().head(2 * joints).array() += 1e-9;
        p.trial = p.at + dense::solve_symmetric(damped, p.now.g);
        if (p.trial.allFinite())
            return;
        p.damping *= HARDER;
    }
    end_horizon(p);
}

// What the trajectory from p.trial says.
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
    const double settled = p.whole ? SETTLED : SETTLED_ROUGHLY;
    const bool done = p.now.squares - there.squares <= settled * p.now.squares;
    p.at = p.trial;
    p.now = std::move(there);
    p.damping = std::max(EASIER * p.damping, LEAST_DAMPING);
    if (done)
        end_horizon(p);
    else
        propose(p);
}

// What is known of hidden states: H += 1/s^2, g += (z - z0)/s^2.
void WindowFit::add_known(const Progress &p, WindowNormal &out) const
{
    constexpr double PRECISION = 1.0 / (HIDDEN_STD * HIDDEN_STD);
    for (long s = 2 * mk_model_joints(f.model); s < ns; s++) {
        const double off = p.known(s) - p.trial(s);
        out.H(s, s) += PRECISION;
        out.g(s) += off * PRECISION;
        out.squares += off * off * PRECISION;
    }
}

double WindowFit::cost(const VectorXd &x)
{
    WindowNormal n;
    return linearise(x, to, false, n) ? n.squares : HUGE_VAL;
}

bool WindowFit::normal_at(const VectorXd &x, WindowNormal &out)
{
    if (!linearise(x, to, free != nullptr, out))
        return false;
    for (long s = 2 * mk_model_joints(f.model); s < ns; s++)
        out.H(s, s) += 1.0 / (HIDDEN_STD * HIDDEN_STD);
    return true;
}

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

// J'J, J'r and r'r of the readings of rows [from, last) about the trajectory from x.
bool WindowFit::linearise(const VectorXd &x, size_t last, bool parameters, WindowNormal &out)
{
    ShootTask task = task_over(x, last, ns + (parameters ? (int)free->size() : 0));
    shoot(task);
    return normal_of(task, out);
}

ShootTask WindowFit::task_over(const VectorXd &x, size_t last, int columns)
{
    return task_from(x, std::max(f.t[last - 1] - f.oldest, f.t[from]), columns);
}

bool WindowFit::normal_of(const ShootTask &task, WindowNormal &out) const
{
    if (!task.finite)
        return false;
    const long n = (long)task.row_count;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<const RowMajor> J(task.jac, n, task.columns);
    Eigen::Map<const VectorXd> r(task.residual, n);
    out.H = J.transpose() * J;
    out.g = J.transpose() * r;
    out.squares = r.squaredNorm();
    out.readings = task.row_count;
    return std::isfinite(out.squares);
}

ShootTask WindowFit::task_from(const VectorXd &x, double end, int columns)
{
    ShootTask task = {};
    task.model = f.model;
    task.data = &f.data;
    task.begin = f.t[from];
    task.end = end;
    task.last = true;
    task.x = x.data();
    task.step = STEP;
    task.columns = columns;
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

// What effects remember at `row`, by runs of the model from `back` on. Where all joints are read
// the run is set back to the readings again and again: what the model lacks must not carry it away.
static void remember(const mk_start_finder &f, size_t last, size_t back, size_t row, VectorXd &x)
{
    constexpr double ALONE = 0.04; // s
    const long measured = 2 * mk_model_joints(f.model), own = x.size() - measured;
    const double piece = mk_model_hides_joint(f.model) ? HUGE_VAL : ALONE;
    VectorXd run(x.size()), at(x.size());
    for (size_t k = back; k < row;) {
        if (mk_record_state_at(f.record, f.model, 0, last, k, 0, at.data(), nullptr) != MK_OK)
            return;
        if (k > back)
            at.tail(own) = run.tail(own);
        run = at;
        size_t next = k + 1;
        while (next < row && f.t[next] - f.t[k] < piece)
            next++;
        WindowFit piece_run(f, k, next + 1);
        if (!piece_run.carry(run, next))
            return;
        k = next;
    }
    x.tail(own) = run.tail(own);
}

// State at `row` to start a search from: angles and speeds by polynomial; what effects remember of
// the past by a run of the model from a while before.
bool first_guess(const mk_start_finder &f, size_t last, size_t row, VectorXd &x)
{
    constexpr double MEMORY = 0.5; // s
    if (mk_record_state_at(f.record, f.model, 0, last, row, 0, x.data(), nullptr) != MK_OK)
        return false;
    size_t back = row;
    while (back > 0 && f.t[row] - f.t[back - 1] <= MEMORY)
        back--;
    if (x.size() > 2 * mk_model_joints(f.model) && back < row)
        remember(f, last, back, row, x);
    return true;
}

} // namespace mk

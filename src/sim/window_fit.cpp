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
    const VectorXd known = x;
    const double length = f.t[to - 1] - f.t[from];
    bool any = false;
    for (double horizon = FIRST_HORIZON;; horizon *= LONGER) {
        const bool all = horizon >= length;
        size_t last = to;
        while (!all && last > from + FEWEST_READINGS && f.t[last - 1] - f.t[from] > horizon)
            last--;
        VectorXd longer = x;
        if (!descend(longer, known, last, all ? SETTLED : SETTLED_ROUGHLY))
            break;
        x = longer;
        any = true;
        if (all)
            break;
    }
    return any;
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

// Levenberg and Marquardt over rows [from, last): (H + l diag H) d = g.
bool WindowFit::descend(VectorXd &x, const VectorXd &known, size_t last, double settled)
{
    constexpr double LEAST = 1e-9, MOST = 1e6, EASIER = 0.1, HARDER = 10.0; // l
    const long joints = mk_model_joints(f.model);
    double damping = 1e-4;
    WindowNormal now, there;
    if (!normal_equations(x, known, last, now))
        return false;
    for (int i = 0; i < MOST_STEPS && damping < MOST; i++) {
        MatrixXd damped = now.H;
        damped.diagonal() *= 1.0 + damping;
        damped.diagonal().head(2 * joints).array() += 1e-9;
        const VectorXd trial = x + dense::solve_symmetric(damped, now.g);
        if (!trial.allFinite() || !normal_equations(trial, known, last, there) ||
            !(there.squares <= now.squares)) {
            damping *= HARDER;
            continue;
        }
        const bool done = now.squares - there.squares <= settled * now.squares;
        x = trial;
        std::swap(now, there);
        damping = std::max(EASIER * damping, LEAST);
        if (done)
            break;
    }
    return true;
}

// Readings and what is known of hidden states: H = J'J + 1/s^2, g = J'r + (z - z0)/s^2.
bool WindowFit::normal_equations(const VectorXd &x, const VectorXd &known, size_t last,
                                 WindowNormal &out)
{
    if (!linearise(x, last, false, out))
        return false;
    constexpr double PRECISION = 1.0 / (HIDDEN_STD * HIDDEN_STD);
    for (long s = 2 * mk_model_joints(f.model); s < ns; s++) {
        const double off = known(s) - x(s);
        out.H(s, s) += PRECISION;
        out.g(s) += off * PRECISION;
        out.squares += off * off * PRECISION;
    }
    return true;
}

// J'J, J'r and r'r of the readings of rows [from, last) about the trajectory from x.
bool WindowFit::linearise(const VectorXd &x, size_t last, bool parameters, WindowNormal &out)
{
    const int columns = ns + (parameters ? (int)free->size() : 0);
    ShootTask task = task_from(x, std::max(f.t[last - 1] - f.oldest, f.t[from]), columns);
    shoot(task);
    if (!task.finite)
        return false;
    const long n = (long)task.row_count;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<const RowMajor> J(jac.data(), n, columns);
    Eigen::Map<const VectorXd> r(residual.data(), n);
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

// The state from which a free run over a window starts: least squares over the window's own
// readings.
//
// A free run measures a model only if its start state is the best that the model allows: angles
// and speeds read off the log carry the readings' noise into the whole window, most of all the
// speeds. So the start state x0 is a nuisance, the same for every model:
//     x0 = argmin sum_k |W (y_k - h(x(t_k; x0)))|^2 + |(z0 - z)/s|^2 ,
// y_k the readings of the window, W one over the resolution of each encoder, z0 the states of
// effects, known (z) from a run of the model through the readings before the window. Levenberg and
// Marquardt's method with exact derivatives, on longer and longer beginnings of the window: over a
// short one the trajectory is nearly linear in x0, and its optimum is where the next one starts (a
// progressive horizon). Nothing asks how well the model fits: one that cannot follow its readings
// gets its best start all the same.
#include "sim/start_state.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <new>
#include <vector>

#include "sim/shoot.hpp"

using Eigen::MatrixXd;
using Eigen::VectorXd;

struct mk_start_finder {
    const mk_record *record;
    const mk_model *model;
    std::vector<double> t, u[MK_MAX_INPUTS], w[MK_MAX_JOINTS];
    double oldest = 0.0; // age of the oldest reading (sensor delays), s
    mk::ShootData data;
};

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

// Free runs of the model from row `from`, held against readings.
class WindowFit
{
  public:
    WindowFit(const mk_start_finder &finder, size_t from_row, size_t to_row)
        : f(finder), ns(mk_model_state_count(finder.model)), from(from_row), to(to_row)
    {
        const size_t capacity = MK_MAX_JOINTS * (to - from) + 64;
        residual.resize(capacity);
        jac.resize(capacity * (size_t)ns);
        x_end.resize((size_t)ns);
        jac_end.resize((size_t)(ns * ns));
    }

    // From x to the least squares over the window; hidden states near those of x. False, and x as
    // it was, if the model runs away from there even over a short beginning.
    bool solve(VectorXd &x)
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
    // Sum of squares over the window; infinite where the model runs away.
    double cost(const VectorXd &x)
    {
        MatrixXd H;
        VectorXd g;
        double sum = HUGE_VAL;
        return linearise(x, to, H, g, sum) ? sum : HUGE_VAL;
    }
    // Where the trajectory from x is at a row.
    bool carry(VectorXd &x, size_t row)
    {
        mk::ShootTask task = task_from(x, f.t[row], false);
        task.row_capacity = 0;
        mk::shoot(task);
        if (!task.finite)
            return false;
        x = Eigen::Map<VectorXd>(x_end.data(), ns);
        return true;
    }

  private:
    const mk_start_finder &f;
    int ns;
    size_t from, to;
    std::vector<double> residual, jac, x_end, jac_end;

    // Levenberg and Marquardt over rows [from, last): (H + l diag H) d = g.
    bool descend(VectorXd &x, const VectorXd &known, size_t last, double settled)
    {
        constexpr double LEAST = 1e-9, MOST = 1e6, EASIER = 0.1, HARDER = 10.0; // l
        const long joints = mk_model_joints(f.model);
        double damping = 1e-4;
        MatrixXd H;
        VectorXd g;
        double now = HUGE_VAL;
        if (!normal_equations(x, known, last, H, g, now))
            return false;
        for (int i = 0; i < MOST_STEPS && damping < MOST; i++) {
            MatrixXd damped = H;
            damped.diagonal() *= 1.0 + damping;
            damped.diagonal().head(2 * joints).array() += 1e-9;
            const VectorXd trial = x + damped.ldlt().solve(g);
            MatrixXd H_there;
            VectorXd g_there;
            double there = HUGE_VAL;
            if (!trial.allFinite() ||
                !normal_equations(trial, known, last, H_there, g_there, there) || !(there <= now)) {
                damping *= HARDER;
                continue;
            }
            const bool done = now - there <= settled * now;
            x = trial;
            H = H_there, g = g_there, now = there;
            damping = std::max(EASIER * damping, LEAST);
            if (done)
                break;
        }
        return true;
    }
    // Readings and what is known of hidden states: H = J'J + 1/s^2, g = J'r + (z - z0)/s^2.
    bool normal_equations(const VectorXd &x, const VectorXd &known, size_t last, MatrixXd &H,
                          VectorXd &g, double &sum)
    {
        if (!linearise(x, last, H, g, sum))
            return false;
        constexpr double PRECISION = 1.0 / (HIDDEN_STD * HIDDEN_STD);
        for (long s = 2 * mk_model_joints(f.model); s < ns; s++) {
            const double off = known(s) - x(s);
            H(s, s) += PRECISION;
            g(s) += off * PRECISION;
            sum += off * off * PRECISION;
        }
        return true;
    }
    // J'J, J'r and r'r of the readings of rows [from, last) about the trajectory from x.
    bool linearise(const VectorXd &x, size_t last, MatrixXd &H, VectorXd &g, double &sum)
    {
        const double end = std::max(f.t[last - 1] - f.oldest, f.t[from]);
        mk::ShootTask task = task_from(x, end, true);
        mk::shoot(task);
        if (!task.finite)
            return false;
        const long n = (long)task.row_count;
        using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
        Eigen::Map<const RowMajor> J(jac.data(), n, ns);
        Eigen::Map<const VectorXd> r(residual.data(), n);
        H = J.transpose() * J;
        g = J.transpose() * r;
        sum = r.squaredNorm();
        return std::isfinite(sum);
    }
    mk::ShootTask task_from(const VectorXd &x, double end, bool derivatives)
    {
        mk::ShootTask task = {};
        task.model = f.model;
        task.data = &f.data;
        task.begin = f.t[from];
        task.end = end;
        task.last = true;
        task.x = x.data();
        task.step = STEP;
        task.columns = derivatives ? ns : 0;
        task.x_end = x_end.data();
        task.jac_end = jac_end.data();
        task.row_capacity = residual.size();
        task.residual = residual.data();
        task.jac = jac.data();
        return task;
    }
};

} // namespace

mk_start_finder *mk_start_finder_create(const mk_record *record, const mk_model *model)
try {
    mk_start_finder *f = new mk_start_finder();
    f->record = record;
    f->model = model;
    f->data = {};
    f->data.rows = record->rows;
    for (size_t k = 0; k < record->rows; k++)
        f->t.push_back(record->t[k] - record->t[0]);
    f->data.t = f->t.data();
    for (int i = 0; i < MK_MAX_INPUTS; i++) {
        double held = 0.0;
        for (size_t k = 0; k < record->rows; k++) {
            double u = record->u[i] ? record->u[i][k] : 0.0;
            held = std::isnan(u) ? held : u;
            f->u[i].push_back(held);
        }
        f->data.u[i] = f->u[i].data();
    }
    for (int j = 0; j < mk_model_joints(model); j++) {
        const double *q = record->q[j];
        const double counts_per_unit = model->encoder_cpr[j] / 6.283185307179586;
        for (size_t k = 0; k < record->rows; k++)
            f->w[j].push_back(std::isnan(q[k]) ? 0.0 : counts_per_unit);
        f->data.q[j] = q;
        f->data.w[j] = f->w[j].data();
    }
    for (int e = 0; e < model->effect_count; e++)
        if (mk_effect(model->effect[e].index)->stages & MK_STAGE_SENSOR_DELAY)
            f->oldest += model->effect[e].value[0];
    return f;
} catch (const std::bad_alloc &) {
    return nullptr;
}

void mk_start_finder_destroy(mk_start_finder *finder)
{
    delete finder;
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
static bool first_guess(const mk_start_finder &f, size_t last, size_t row, VectorXd &x)
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

// Readings of the far side of a play show where the near side is only after a while: the state at
// `row` on the trajectory that fits the readings from `before` seconds earlier on, none at `last`
// or later.
static bool from_earlier(const mk_start_finder &f, size_t row, size_t last, double before,
                         VectorXd &x)
{
    size_t from = row;
    while (from > 0 && f.t[row] - f.t[from - 1] <= before)
        from--;
    if (from == row || !first_guess(f, last, from, x))
        return false;
    WindowFit fit(f, from, last);
    return fit.solve(x) && fit.carry(x, row);
}

enum mk_status mk_start_state(mk_start_finder *f, size_t first, size_t last, double *x,
                              mk_error *err)
try {
    const int ns = mk_model_state_count(f->model);
    enum mk_status st = mk_record_state_at(f->record, f->model, 0, last, first, 0, x, err);
    if (st != MK_OK)
        return st;
    VectorXd best = Eigen::Map<VectorXd>(x, ns), guess(ns);
    if (first_guess(*f, last, first, guess))
        best = guess;
    WindowFit window(*f, first, last);
    window.solve(best);
    double least = window.cost(best);
    if (mk_model_hides_joint(f->model))
        for (double before : {0.5, 2.0, 8.0}) { // s
            if (!from_earlier(*f, first, last, before, guess))
                continue;
            window.solve(guess);
            const double other = window.cost(guess);
            if (other < least)
                least = other, best = guess;
        }
    std::copy(best.data(), best.data() + ns, x);
    return MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory for the start state");
}

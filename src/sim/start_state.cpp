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
    double noise[MK_MAX_JOINTS]; // what quantisation and scatter make, rad
    mk::ShootData data;
};

namespace
{

constexpr double HIDDEN_STD = 0.05; // of effects' states before any reading
constexpr double PASSES = 1.15;     // rms of readings beside a trajectory, standard deviations
constexpr double STEP = 2.5e-3;     // s

// Noise by fourth differences; at least what rounding and a little jitter make.
double noise_of(const double *q, size_t n, double count)
{
    std::vector<double> d;
    for (size_t k = 0; k + 4 < n; k++) {
        double x = q[k] - 4.0 * q[k + 1] + 6.0 * q[k + 2] - 4.0 * q[k + 3] + q[k + 4];
        if (!std::isnan(x))
            d.push_back(std::fabs(x));
    }
    double fast = 0.0;
    if (!d.empty()) {
        auto mid = d.begin() + (std::ptrdiff_t)(d.size() / 2);
        std::nth_element(d.begin(), mid, d.end());
        fast = *mid / (0.6745 * std::sqrt(70.0));
    }
    return std::max(0.4 * count, 1.3 * fast);
}

// A run of the model through readings, around the row wanted.
class Search
{
  public:
    Search(const mk_start_finder &finder, size_t from_row, size_t to_row)
        : f(finder), ns(mk_model_state_count(finder.model)), from(from_row), to(to_row)
    {
        size_t capacity = 2 * (to - from) + 64;
        residual.resize(capacity);
        jac.resize(capacity * (size_t)ns);
        x_end.resize((size_t)ns);
        jac_end.resize((size_t)(ns * ns));
    }

    // Gauss-Newton from x, whose effects' states are a guess too; false when the model runs away.
    // rms is in standard deviations.
    bool solve(VectorXd &x, double &rms)
    {
        const VectorXd rest = x;
        int joints = mk_model_joints(f.model);
        double cost = HUGE_VAL;
        for (int i = 0; i < 12; i++) {
            MatrixXd H;
            VectorXd g;
            double now = 0.0;
            if (!linearise(x, H, g, now, rms))
                return false;
            for (long s = 2 * joints; s < ns; s++) {
                H(s, s) += 1.0 / (HIDDEN_STD * HIDDEN_STD);
                g(s) += (rest(s) - x(s)) / (HIDDEN_STD * HIDDEN_STD);
            }
            if (cost - now < 1e-4 * now)
                return true;
            cost = now;
            H.diagonal() *= 1.0 + 1e-6;
            x += H.ldlt().solve(g);
            if (!x.allFinite())
                return false;
        }
        return true;
    }
    // The same where nothing moves and has not for long: angles alone are to be found.
    bool solve_at_rest(VectorXd &x, double &rms)
    {
        constexpr double SIDE = 1e-6; // rad
        int joints = mk_model_joints(f.model);
        VectorXd q = x.head(joints);
        double cost = HUGE_VAL;
        for (int i = 0; i < 12; i++) {
            x = resting(q);
            MatrixXd H, turn(ns, joints);
            VectorXd g;
            double now = 0.0;
            if (!linearise(x, H, g, now, rms))
                return false;
            if (cost - now < 1e-4 * now)
                return true;
            cost = now;
            for (int j = 0; j < joints; j++) {
                VectorXd beside = q;
                beside(j) += SIDE;
                turn.col(j) = (resting(beside) - x) / SIDE;
            }
            MatrixXd small = turn.transpose() * H * turn;
            small.diagonal() *= 1.0 + 1e-6;
            q += small.ldlt().solve(turn.transpose() * g);
            if (!q.allFinite())
                return false;
        }
        return true;
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

    VectorXd resting(const VectorXd &q) const
    {
        const double still[MK_MAX_JOINTS] = {0.0, 0.0};
        VectorXd x(ns);
        mk_model_initial_state(f.model, q.data(), still, x.data());
        return x;
    }
    // Normal equations of the readings about the trajectory from x.
    bool linearise(const VectorXd &x, MatrixXd &H, VectorXd &g, double &sum, double &rms)
    {
        mk::ShootTask task = task_from(x, f.t[to - 1], true);
        mk::shoot(task);
        if (!task.finite || task.row_count < (size_t)ns)
            return false;
        long n = (long)task.row_count;
        using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
        Eigen::Map<const RowMajor> J(jac.data(), n, ns);
        Eigen::Map<const VectorXd> r(residual.data(), n);
        H = J.transpose() * J;
        g = J.transpose() * r;
        sum = r.squaredNorm();
        rms = std::sqrt(sum / (double)n);
        return true;
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
        f->noise[j] = noise_of(q, record->rows, 6.283185307179586 / model->encoder_cpr[j]);
        for (size_t k = 0; k < record->rows; k++)
            f->w[j].push_back(std::isnan(q[k]) ? 0.0 : 1.0 / f->noise[j]);
        f->data.q[j] = q;
        f->data.w[j] = f->w[j].data();
    }
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
        Search search(f, k, next + 1);
        if (!search.carry(run, next))
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

// The state at `row` on the model's trajectory through the readings from `before` to `after`
// seconds around it; false when no trajectory goes through them.
static bool through_readings(const mk_start_finder &f, size_t last, size_t row, double before,
                             double after, double *x)
{
    size_t from = row, to = row;
    while (from > 0 && f.t[row] - f.t[from - 1] <= before)
        from--;
    while (to < last && f.t[to] - f.t[row] <= after)
        to++;
    VectorXd guess(mk_model_state_count(f.model));
    double rms = 0.0;
    if (to - from < 12 || !first_guess(f, last, from, guess))
        return false;
    Search search(f, from, to);
    // Most logs begin before anything moves, or with a release.
    VectorXd still = guess;
    if (from == 0 && search.solve_at_rest(still, rms) && rms < PASSES)
        guess = still;
    else if (!search.solve(guess, rms) || !(rms < PASSES))
        return false;
    if (!search.carry(guess, row))
        return false;
    std::copy(guess.data(), guess.data() + guess.size(), x);
    return true;
}

enum mk_status mk_start_state(mk_start_finder *f, size_t last, size_t row, double *x, mk_error *err)
try {
    int ns = mk_model_state_count(f->model);
    enum mk_status st = mk_record_state_at(f->record, f->model, 0, last, row, 0, x, err);
    if (st != MK_OK)
        return st;
    VectorXd plain(ns);
    if (first_guess(*f, last, row, plain))
        std::copy(plain.data(), plain.data() + ns, x);
    // Readings of the far side of a play show where the near side is only after a while.
    struct Span {
        double before, after;
    };
    static const Span usual[] = {{0.25, 0.25}, {0.125, 0.125}, {0.0625, 0.0625}};
    static const Span hidden[] = {{20.0, 0.25}, {4.0, 0.25}, {2.0, 0.25}, {1.0, 0.25}};
    if (mk_model_hides_joint(f->model))
        for (const Span &span : hidden)
            if (through_readings(*f, last, row, span.before, span.after, x))
                return MK_OK;
    for (const Span &span : usual)
        if (through_readings(*f, last, row, span.before, span.after, x))
            return MK_OK;
    return MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory for the start state");
}

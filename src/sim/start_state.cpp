// The state from which a free run over a window starts: least squares over the window's own
// readings.
//
// A free run measures a model only if its start state is the best that the model allows: angles
// and speeds read off the log carry the readings' noise into the whole window, most of all the
// speeds. So the start state x0 is a nuisance, the same for every model:
//     x0 = argmin sum_k |W (y_k - h(x(t_k; x0)))|^2 + |(z0 - z)/s|^2 ,
// y_k the readings of the window, W one over the resolution of each encoder, z0 the states of
// effects, known (z) from a run of the model through the readings before the window
// (window_fit.cpp). Nothing asks how well the model fits: one that cannot follow its readings gets
// its best start all the same.
#include "sim/start_state.h"

#include <algorithm>
#include <cmath>
#include <new>

#include "sim/effect_memory.hpp"

using Eigen::VectorXd;

std::unique_ptr<mk_start_finder> mk::basic_finder(const mk_record &log, const mk_model &m)
{
    const mk_record *record = &log;
    const mk_model *model = &m;
    auto f = std::make_unique<mk_start_finder>();
    f->record = record;
    f->model = model;
    f->data = {};
    f->data.rows = record->rows;
    for (size_t k = 0; k < record->rows; k++)
        f->t.push_back(record->t[k] - record->begins);
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
        const double counts_per_unit = 1.0 / mk_model_count(model, j);
        for (size_t k = 0; k < record->rows; k++)
            f->w[j].push_back(std::isnan(q[k]) ? 0.0 : counts_per_unit);
        f->data.q[j] = q;
        f->data.w[j] = f->w[j].data();
    }
    return f;
}

mk_start_finder *mk_start_finder_create(const mk_record *record, const mk_model *model)
try {
    std::unique_ptr<mk_start_finder> f = mk::basic_finder(*record, *model);
    if (mk::remembers(*model))
        f->way = mk::way_of(*record, *model);
    mk::remember(*f);
    return f.release();
} catch (const std::bad_alloc &) {
    return nullptr;
}

void mk_start_finder_destroy(mk_start_finder *finder)
{
    delete finder;
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
    if (from == row || !mk::first_guess(f, last, from, x))
        return false;
    mk::WindowFit fit(f, from, last);
    return fit.solve(x) && fit.carry(x, row);
}

// Where the search for the start state of a window begins; MK_ERR_RANGE: too few readings.
static enum mk_status begin_at(const mk_start_finder &f, const mk_row_range &window, VectorXd &x,
                               mk_error *err)
{
    VectorXd guess(mk_model_state_count(f.model));
    x = guess;
    enum mk_status st =
        mk_record_state_at(f.record, f.model, 0, window.last, window.first, 0, x.data(), err);
    if (st == MK_OK && mk::first_guess(f, window.last, window.first, guess))
        x = guess;
    return st;
}

enum mk_status mk_start_state(mk_start_finder *f, size_t first, size_t last, double *x,
                              mk_error *err)
try {
    VectorXd best;
    enum mk_status st = begin_at(*f, {first, last}, best, err);
    if (st != MK_OK)
        return st;
    mk::WindowFit window(*f, first, last);
    window.solve(best);
    VectorXd guess(best.size());
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
    std::copy(best.data(), best.data() + best.size(), x);
    return MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory for the start state");
}

enum mk_status mk_start_states(mk_start_finder *f, const mk_row_range *windows, size_t count,
                               double *x, enum mk_status *status, mk_error *err)
try {
    // The far side of a play is found in windows of its own.
    const bool each = mk_model_hides_joint(f->model);
    std::vector<mk::WindowFit> fits;
    std::vector<VectorXd> states;
    std::vector<size_t> of;
    fits.reserve(count);
    for (size_t i = 0; i < count; i++) {
        const mk_row_range &w = windows[i];
        if (each) {
            status[i] = mk_start_state(f, w.first, w.last, x + i * MK_MAX_STATES, err);
            continue;
        }
        VectorXd begin;
        status[i] = begin_at(*f, w, begin, err);
        if (status[i] != MK_OK)
            continue;
        fits.emplace_back(*f, w.first, w.last);
        states.push_back(std::move(begin));
        of.push_back(i);
    }
    mk::WindowFit::solve(fits, states);
    for (size_t k = 0; k < of.size(); k++)
        std::copy(states[k].data(), states[k].data() + states[k].size(), x + of[k] * MK_MAX_STATES);
    return MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory for the start states");
}

enum mk_status mk_free_angles(mk_start_finder *f, const mk_row_range *windows, size_t count,
                              const double *x, enum mk_status *status,
                              double *const q[MK_MAX_JOINTS], mk_error *err)
try {
    const long ns = mk_model_state_count(f->model);
    std::vector<mk::WindowFit> fits;
    std::vector<VectorXd> states;
    std::vector<size_t> of;
    fits.reserve(count);
    for (size_t i = 0; i < count; i++) {
        if (status[i] != MK_OK)
            continue;
        fits.emplace_back(*f, windows[i].first, windows[i].last);
        states.emplace_back(Eigen::Map<const VectorXd>(x + i * MK_MAX_STATES, ns));
        of.push_back(i);
    }
    const std::vector<char> fine = mk::WindowFit::angles(fits, states, q);
    for (size_t k = 0; k < of.size(); k++)
        if (!fine[k])
            status[of[k]] = mk_error_set(err, MK_ERR_NUMERIC, "the model runs away");
    return MK_OK;
} catch (const std::bad_alloc &) {
    return mk_error_set(err, MK_ERR_NOMEM, "no memory for the free runs");
}

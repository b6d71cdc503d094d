#include "ctrl/track.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <vector>

#include "ctrl/swingup_solve.hpp"

using namespace mk::swing;

namespace
{

// Sizes of errors that count alike along the way: Q = diag(1 / size^2) per second, r = 1 / u_max^2.
constexpr double ANGLE = 0.3;     // rad; of a slide by its scale
constexpr double SPEED = 3.0;     // rad/s
constexpr double WHEEL = 100.0;   // rad/s
constexpr double COMMAND = 0.5;   // of u_max
constexpr double LOST = 15.0;     // e' S e: 1 is the border of what balancing brings back
constexpr double START = 0.5;     // of these sizes: the rig hangs still
constexpr double LINGER_S = 0.25; // after the end: the last gain goes on
constexpr double GAP_S = 0.05;    // not asked for so long: something else has driven since

enum Phase { WAITING, FOLLOWING, OVER };

} // namespace

struct mk_track {
    double dt, u_max;
    State size; // of errors that count alike
    Phase phase = WAITING;
    double start = 0.0, last = 0.0; // s
    std::vector<double> u;          // n + 1; the last holds the equilibrium
    std::vector<State> x, gain;     // n + 1
    std::vector<StateMatrix> cost;  // n + 1: S_k
};

namespace
{

State sizes_of(const mk_model &model)
{
    State size;
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        bool wheel = mk_model_turns_freely(&model, j);
        double scale = mk_model_joint_scale(&model, j);
        size(j) = wheel ? HUGE_VAL : ANGLE * scale;
        size(2 + j) = (wheel ? WHEEL : SPEED) * scale;
    }
    return size;
}

// The recursion of track.h, from the end.
void find_gains(const Dynamics &d, const StateMatrix &end, mk_track &t)
{
    const size_t n = t.x.size() - 1;
    const State &size = t.size = sizes_of(d.model);
    StateMatrix q = StateMatrix::Zero(), a, s = end;
    for (int i = 0; i < MK_CTRL_STATES; i++)
        q(i, i) = std::isfinite(size(i)) ? t.dt / (size(i) * size(i)) : 0.0;
    const double r = t.dt / (COMMAND * t.u_max * COMMAND * t.u_max);
    t.gain.resize(n + 1);
    t.cost.resize(n + 1);
    t.cost[n] = s;
    State b;
    for (size_t k = n; k-- > 0;) {
        d.move(t.x[k], t.u[k], t.dt, a, b);
        State sb = s * b;
        t.gain[k] = a.transpose() * sb / (r + b.dot(sb));
        s = (q + a.transpose() * s * (a - b * t.gain[k].transpose())).eval();
        s = (0.5 * (s + s.transpose())).eval();
        t.cost[k] = s;
    }
    t.gain[n] = t.gain[n - 1];
}

} // namespace

enum mk_status mk_track_create(const mk_swingup *s, const mk_roa *roa, mk_track **out,
                               mk_error *err)
{
    *out = nullptr;
    mk_track *t = nullptr;
    try {
        t = new mk_track();
        t->dt = 1.0 / s->rate_hz;
        t->u_max = roa->model->u_max;
        t->u.assign(s->u, s->u + s->count);
        t->u.push_back(0.0);
        for (size_t k = 0; k <= s->count; k++) {
            const double *x = s->x + k * MK_SWINGUP_STATES;
            t->x.push_back(State(x[0], x[1], x[2], x[3]));
        }
        StateMatrix end;
        for (int i = 0; i < MK_CTRL_STATES; i++)
            for (int j = 0; j < MK_CTRL_STATES; j++)
                end(i, j) = roa->p[MK_CTRL_STATES * i + j] / roa->level;
        find_gains(Dynamics(s->model), end, *t);
    } catch (const std::bad_alloc &) {
        delete t;
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for a swing-up");
    }
    if (!t->cost[0].allFinite()) {
        delete t;
        return mk_error_set(err, MK_ERR_NUMERIC, "no gains can be found along this swing-up");
    }
    *out = t;
    return MK_OK;
}

void mk_track_destroy(mk_track *track)
{
    delete track;
}

void mk_track_reset(mk_track *track)
{
    if (track)
        track->phase = WAITING;
}

// x* at `since` seconds, between the samples on a straight line.
static State nominal(const mk_track &t, double since)
{
    const size_t n = t.x.size() - 1;
    const double at = std::max(since / t.dt, 0.0);
    if (!(at < (double)n))
        return t.x[n];
    const size_t i = (size_t)at;
    const double share = at - (double)i;
    return (1.0 - share) * t.x[i] + share * t.x[i + 1];
}

bool mk_track_follow(mk_track *t, const double *state, double now, double ahead_s, double *u)
{
    if (!t || t->phase == OVER)
        return false;
    const State x(state[0], state[1], state[2], state[3]);
    if (t->phase == WAITING) {
        bool hangs = ((x - t->x[0]).array() / t->size.array()).abs().maxCoeff() <= START;
        t->start = t->last = now;
        t->phase = hangs ? FOLLOWING : OVER;
    }
    const size_t n = t->x.size() - 1;
    const double since = now - t->start;
    const size_t k = std::min((size_t)std::max(std::lround(since / t->dt), 0L), n);
    const State e = x - nominal(*t, since + ahead_s);
    bool over = now - t->last > GAP_S || since > (double)n * t->dt + LINGER_S;
    t->last = now;
    if (over || t->phase == OVER || !(e.dot(t->cost[k] * e) <= LOST)) {
        t->phase = OVER;
        return false;
    }
    *u = std::clamp(t->u[k] - t->gain[k].dot(e), -t->u_max, t->u_max);
    return true;
}

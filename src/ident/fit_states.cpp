// Fit: where shooting intervals start, and the states there before anything is fitted.
//
// Gauss-Newton needs states near the right ones. Angles and speeds of a node come from local
// polynomials through the readings around it (mk_record_state_at), which no model can lead astray.
// The states of effects (a bristle, the far side of a backlash) are not in the readings: the model
// hands them on from shooting interval to shooting interval, x_(i+1) = F_i(x_i, p), angles and
// speeds being those of the readings again at every node.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/parallel.hpp"
#include "ident/fit_priv.hpp"

namespace mk
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Joint of the effect that a parameter belongs to; -1 of a base parameter.
static int joint_of(const mk_model &model, int number)
{
    number -= mk_plant(model.plant)->parameter_count;
    for (int e = 0; number >= 0 && e < model.effect_count; e++) {
        const int count = mk_effect(model.effect[e].index)->parameter_count;
        if (number < count)
            return model.effect[e].joint;
        number -= count;
    }
    return -1;
}

// Rows of the shooting nodes: about duration / interval intervals of the same length, the nearest
// row at or after t_i = duration i / count. A node needs more than three rows to the one before it,
// so that every interval has readings of its own; else it is left out.
static std::vector<size_t> node_rows(const FitLog &log, double interval)
{
    std::vector<size_t> rows;
    long count = std::lround(log.duration() / interval);
    if (count < 1)
        count = 1;
    for (long i = 0; i < count; i++) {
        double t = log.duration() * (double)i / (double)count;
        size_t row =
            (size_t)(std::lower_bound(log.t.begin(), log.t.end(), t - 1e-9) - log.t.begin());
        if (rows.empty() || row > rows.back() + 3)
            rows.push_back(row);
    }
    return rows;
}

// The log as mk_record_state_at() takes it.
static mk_record record_of(const FitLog &log)
{
    mk_record r = {};
    r.rows = log.rows();
    r.t = log.t.data();
    for (int j = 0; j < log.joints; j++)
        r.q[j] = log.q[j].data();
    for (int i = 0; i < MK_MAX_INPUTS; i++)
        r.u[i] = log.u[i].data();
    return r;
}

// Start of a fit. The noise of each joint's readings is the largest, over logs, of what their
// scatter shows and of the rounding to counts, count / sqrt(12) (uniform over one count).
FitPoint Fit::start(const mk_model &model)
{
    FitPoint p;
    p.model = model;
    p.model.effect_count = 0; // states of effects come with them, below
    int ns = 2 * mk_model_joints(&model);
    for (const FitLog *log : logs) {
        ShootingNodes nodes;
        nodes.row = node_rows(*log, options.interval);
        nodes.x.resize(ns, (long)nodes.row.size());
        mk_record record = record_of(*log);
        // Angles and speeds of the node: a local polynomial through the readings on both sides.
        double x[MK_MAX_STATES] = {0.0};
        for (size_t i = 0; i < nodes.row.size(); i++) {
            // Where readings are missing the last state known will do: the fit repairs it.
            (void)!mk_record_state_at(&record, &model, 0, log->rows(), nodes.row[i], 0, x, nullptr);
            for (int s = 0; s < ns; s++)
                nodes.x(s, (long)i) = x[s];
        }
        p.nodes.push_back(std::move(nodes));
        for (int j = 0; j < log->joints; j++) {
            double quantised = log->count[j] / std::sqrt(12.0);
            p.noise[j] = std::max({p.noise[j], fit_log_noise(*log, j), quantised});
        }
    }
    return adopt(p, model);
}

// Own values of parameters that both models have; others start at their means.
// Sources that `from` did not have start at the means too.
void Fit::adopt_own(const FitPoint &from, FitPoint &to) const
{
    const std::vector<int> own = own_parameters(to.model), known = own_parameters(from.model);
    to.own.clear();
    if (own.empty())
        return;
    // One vector of own values for every source that there is, in the order of
    // own_parameters(to.model).
    int count = 0;
    for (const FitLog *log : logs)
        count = std::max(count, log->source + 1);
    // Own values of a parameter are known by its name and joint: its number changes with the
    // effects before it.
    to.own.assign((size_t)count, VectorXd::Zero((long)own.size()));
    for (size_t i = 0; i < own.size(); i++) {
        char name[64];
        (void)mk_model_parameter_info(&to.model, own[i], name, sizeof name);
        const int joint = joint_of(to.model, own[i]);
        for (size_t k = 0; k < known.size(); k++) {
            char other[64];
            (void)mk_model_parameter_info(&from.model, known[k], other, sizeof other);
            if (std::strcmp(name, other) != 0 || joint != joint_of(from.model, known[k]))
                continue;
            for (size_t n = 0; n < std::min(to.own.size(), from.own.size()); n++)
                to.own[n]((long)i) = from.own[n]((long)k);
        }
    }
}

// Angles, speeds and noise stay those of `from`, and so do the nodes where neither model or both
// hide a joint. States of effects are made anew, of all effects: at rest at the first node, then
// handed on by the model. The cost is that of `from` until it is computed.
FitPoint Fit::adopt(const FitPoint &from, const mk_model &model)
{
    FitPoint p = from;
    p.model = model;
    adopt_own(from, p);
    // The step that was short enough for the model before; with contact, within a factor of SHORTER
    // below the longest one.
    if (p.step > 0.0 && mk_model_event_count(&model) > 0)
        p.step = std::min(std::max(p.step, SHORTER * longest_step(model)), longest_step(model));
    int joints = mk_model_joints(&model), ns = mk_model_state_count(&model);
    // A model that hides a side of a joint has few, long shooting intervals (thin). One that no
    // longer does gets the short ones back, from the readings; only the noise is kept.
    const bool hidden = mk_model_hides_joint(&model),
               was_hidden = mk_model_hides_joint(&from.model);
    if (was_hidden && !hidden) {
        p = start(model);
        std::copy(std::begin(from.noise), std::end(from.noise), std::begin(p.noise));
    }
    for (size_t l = 0; l < p.nodes.size(); l++) {
        const MatrixXd known = p.nodes[l].x;
        p.nodes[l].x.resize(ns, known.cols());
        for (long i = 0; i < known.cols(); i++) {
            // Effects' states at rest for the angles and speeds of the node.
            double full[MK_MAX_STATES];
            mk_model_initial_state(&model, &known(0, i), &known(joints, i), full);
            for (int s = 0; s < ns; s++)
                p.nodes[l].x(s, i) = full[s];
        }
    }
    if (ns > 2 * joints) {
        if (hidden && !was_hidden)
            for (ShootingNodes &nodes : p.nodes)
                thin(nodes);
        prepare(p);
        parallel_for(options.threads, p.nodes.size(), [&](size_t l) {
            if (hidden)
                carry_apart(p, l);
            else
                carry_states(p, l);
        });
    }
    return p;
}

// Keeps every n-th node, n = hidden_interval / interval. With short shooting intervals hidden
// states can explain readings that the model does not: false optima, one for each side that a joint
// may touch. Where the trajectory is not chaotic, long shooting intervals have none of them.
void Fit::thin(ShootingNodes &nodes) const
{
    size_t step =
        std::max<size_t>(1, (size_t)std::lround(options.hidden_interval / options.interval));
    ShootingNodes kept;
    for (size_t i = 0; i < nodes.row.size(); i += step) {
        kept.row.push_back(nodes.row[i]);
        kept.x.conservativeResize(nodes.x.rows(), (long)kept.row.size());
        kept.x.rightCols(1) = nodes.x.col((long)i);
    }
    nodes = std::move(kept);
}

// A light side in a backlash is seen, its heavy side is not. At first both are together at every
// node. With q, v of the heavy side (the joint's coordinates) and y, w of the light side (the
// effect's first two states), the readings give y. The end of the interval before gives how far
// they are apart:
//     y_(i+1) = y read ,   q_(i+1) = y read - (y - q)(end of interval i) ,   w, v likewise.
// Ends where the model runs away: nodes behind keep both sides together. So does carry_states(),
// whose nodes then keep their states at rest.
void Fit::carry_apart(FitPoint &point, size_t l)
{
    ShootingNodes &nodes = point.nodes[l];
    const mk_model &m = point.model;
    long joints = mk_model_joints(&m);
    for (size_t i = 0; i + 1 < nodes.row.size(); i++) {
        shoot_one(point, l, i);
        if (!work[l][i].finite)
            return;
        const VectorXd &end = work[l][i].x_end;
        auto next = nodes.x.col((long)i + 1);
        // Angles and speeds by polynomial: those of the side that carries the encoder.
        const VectorXd seen = next;
        long at = 2 * joints;
        for (int e = 0; e < m.effect_count; e++) {
            const mk_effect_info *info = mk_effect(m.effect[e].index);
            next.segment(at, info->state_count) = end.segment(at, info->state_count);
            if ((info->stages & MK_STAGE_STATE) && (info->stages & MK_STAGE_MEASUREMENT)) {
                long j = m.effect[e].joint - 1;
                // k = 0: angle, k = 1: speed.
                for (long k = 0; k < 2; k++) {
                    long own = k * joints + j;
                    next(own) = seen(own) - (end(at + k) - end(own));
                    next(at + k) = seen(own);
                }
            }
            at += info->state_count;
        }
    }
}

// States of effects that do not hide a joint: those at the end of an interval are those of the next
// node. Angles and speeds stay at what the readings say.
void Fit::carry_states(FitPoint &point, size_t l)
{
    ShootingNodes &nodes = point.nodes[l];
    long own = 2 * mk_model_joints(&point.model), ns = nodes.x.rows();
    for (size_t i = 0; i + 1 < nodes.row.size(); i++) {
        shoot_one(point, l, i);
        if (!work[l][i].finite)
            return;
        nodes.x.col((long)i + 1).tail(ns - own) = work[l][i].x_end.tail(ns - own);
    }
}

// --- shooting ---

// Lays out data and one segment for each interval, [t of its node, t of the next one). To be called
// whenever nodes, noise, own values or the model have changed; what was shot before stays in
// `work`.
void Fit::prepare(const FitPoint &point)
{
    lay_data(point);
    work.resize(logs.size());
    for (size_t l = 0; l < logs.size(); l++) {
        const ShootingNodes &nodes = point.nodes[l];
        if (work[l].size() != nodes.row.size())
            slopes.reset();
        work[l].resize(nodes.row.size());
        for (size_t i = 0; i < nodes.row.size(); i++) {
            Segment &s = work[l][i];
            s.begin = logs[l]->t[nodes.row[i]];
            // The last interval ends with the log and has no continuity defect.
            s.last = i + 1 == nodes.row.size();
            s.end = s.last ? logs[l]->duration() : logs[l]->t[nodes.row[i + 1]];
            // The doubt of the command depends on the node's state, by the mass matrix there.
            add_input_uncertainty(point, l, i);
        }
    }
}

} // namespace mk

#include "explain/report/residual_torque.hpp"

#include <cmath>

namespace mk
{

void find_pushes(const std::vector<const FitLog *> &training, const mk_model &given,
                 const Hypothesis &refit, const Hypothesis &best, int threads, mk_explanation &out)
{
    FitOptions o;
    o.threads = threads;
    o.stretch = 0.06;
    o.max_iterations = 8;
    for (double &d : o.drift)
        d = std::max(refit.drift, 1.0);
    mk_model bare = best.point.model;
    bare.effect_count = given.effect_count;
    Fit fit(training, o);
    FitPoint point = fit.start(bare);
    std::copy(std::begin(best.point.noise), std::end(best.point.noise), std::begin(point.noise));
    if (!fit.minimise(point, {}))
        return;
    FitResiduals r = fit.residuals(point);
    int n = mk_model_joints(&given);
    size_t total = 0, index = 0;
    for (const FitNodes &nodes : point.nodes)
        total += nodes.row.size();
    size_t skip = total / MK_MAX_PUSHES + 1;
    double squares[MK_MAX_JOINTS] = {0.0, 0.0};
    for (size_t l = 0; l < training.size(); l++) {
        const FitNodes &nodes = point.nodes[l];
        for (size_t i = 1; i < nodes.row.size(); i++) {
            double span = training[l]->t[nodes.row[i]] - training[l]->t[nodes.row[i - 1]];
            double mass[4], h[2], q[2] = {0.0, 0.0}, v[2] = {0.0, 0.0}, a[2] = {0.0, 0.0};
            for (int j = 0; j < n; j++) {
                q[j] = 0.5 * (nodes.x(j, (long)i) + nodes.x(j, (long)i - 1));
                v[j] = 0.5 * (nodes.x(n + j, (long)i) + nodes.x(n + j, (long)i - 1));
                a[j] = r.jump[l](n + j, (long)i) / span;
            }
            mk_plant_mass(&bare, q, v, mass, h);
            mk_push push = {};
            push.t = training[l]->start + training[l]->t[nodes.row[i]] - 0.5 * span;
            push.u = training[l]->u[0][(nodes.row[i] + nodes.row[i - 1]) / 2];
            for (int j = 0; j < n; j++) {
                push.q[j] = q[j];
                push.v[j] = v[j];
                for (int k = 0; k < n; k++)
                    push.torque[j] += mass[j * n + k] * a[k];
                squares[j] += push.torque[j] * push.torque[j];
            }
            if (index++ % skip == 0 && out.push_count < MK_MAX_PUSHES)
                out.push[out.push_count++] = push;
        }
    }
    for (int j = 0; j < n; j++)
        out.missing[j] = std::sqrt(squares[j] / std::max<double>((double)index, 1.0));
}

} // namespace mk

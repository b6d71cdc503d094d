#include "explain/report/residual_torque.hpp"

#include <cmath>

namespace mk
{

void find_residual_torques(const std::vector<const FitLog *> &training, const mk_model &given,
                           const Hypothesis &refit, const Hypothesis &best, int threads,
                           mk_explanation &out)
{
    FitOptions o;
    o.threads = threads;
    o.interval = 0.06;
    o.max_iterations = 8;
    for (double &d : o.process_noise)
        d = std::max(refit.process_noise, 1.0);
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
    for (const ShootingNodes &nodes : point.nodes)
        total += nodes.row.size();
    size_t skip = total / MK_MAX_RESIDUAL_TORQUES + 1;
    double squares[MK_MAX_JOINTS] = {0.0, 0.0};
    for (size_t l = 0; l < training.size(); l++) {
        const ShootingNodes &nodes = point.nodes[l];
        for (size_t i = 1; i < nodes.row.size(); i++) {
            double span = training[l]->t[nodes.row[i]] - training[l]->t[nodes.row[i - 1]];
            double mass[4], h[2], q[2] = {0.0, 0.0}, v[2] = {0.0, 0.0}, a[2] = {0.0, 0.0};
            for (int j = 0; j < n; j++) {
                q[j] = 0.5 * (nodes.x(j, (long)i) + nodes.x(j, (long)i - 1));
                v[j] = 0.5 * (nodes.x(n + j, (long)i) + nodes.x(n + j, (long)i - 1));
                a[j] = r.defect[l](n + j, (long)i) / span;
            }
            mk_plant_mass(&bare, q, v, mass, h);
            mk_residual_torque here = {};
            here.t = training[l]->start + training[l]->t[nodes.row[i]] - 0.5 * span;
            here.u = training[l]->u[0][(nodes.row[i] + nodes.row[i - 1]) / 2];
            for (int j = 0; j < n; j++) {
                here.q[j] = q[j];
                here.v[j] = v[j];
                for (int k = 0; k < n; k++)
                    here.torque[j] += mass[j * n + k] * a[k];
                squares[j] += here.torque[j] * here.torque[j];
            }
            if (index++ % skip == 0 && out.residual_torque_count < MK_MAX_RESIDUAL_TORQUES)
                out.residual_torque[out.residual_torque_count++] = here;
        }
    }
    for (int j = 0; j < n; j++)
        out.missing[j] = std::sqrt(squares[j] / std::max<double>((double)index, 1.0));
}

} // namespace mk

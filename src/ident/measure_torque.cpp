// A slow sweep of the pendulum: the command that holds it at an angle, friction taken off by going
// both ways, is m g l sin q. Weighed and measured, m g l in N m then gives the torque constant.
#include <cmath>
#include <limits>

#include "ident/measure.hpp"
#include "model/scalar.hpp"

namespace mk
{

namespace
{

constexpr double PIECE_S = 0.2;
constexpr double SLOWEST = 0.1, FASTEST = 1.0; // rad/s

bool creeps(const Section &p)
{
    double a = std::fabs(p.v_begin), b = std::fabs(p.v_end);
    return p.v_begin * p.v_end > 0.0 && a > SLOWEST && b > SLOWEST && a < FASTEST && b < FASTEST;
}

enum mk_status run(const MeasureProblem &problem, mk_measurement &out, mk_error *err)
{
    const mk_model &m = problem.model;
    std::vector<Section> pieces;
    int up = 0, down = 0;
    for (const Section &p : cut(problem, PIECE_S))
        if (creeps(p)) {
            pieces.push_back(p);
            (p.v > 0.0 ? up : down)++;
        }
    if (up < 5 || down < 5)
        return mk_error_set(err, MK_ERR_RANGE,
                            "%d pieces of %g s that move slowly (%g to %g rad/s) up, %d down: 5 "
                            "each are needed",
                            up, PIECE_S, SLOWEST, FASTEST, down);
    Eigen::MatrixXd x((long)pieces.size(), 2);
    Eigen::VectorXd y((long)pieces.size());
    for (size_t i = 0; i < pieces.size(); i++) {
        const Section &p = pieces[i];
        x((long)i, 0) = std::sin(p.q);
        x((long)i, 1) = smooth_sign(m.friction_sharpness, p.v);
        // Inertia and viscous friction take little; the model knows them well enough.
        y((long)i) = p.u - m.parameter[0] * p.a - m.parameter[2] * p.v;
    }
    Regressed r = regress_plain(x, y);
    if (!r.determined)
        return mk_error_set(err, MK_ERR_RANGE, "the sweep does not tell weight from friction");
    for (size_t i = 0; i < pieces.size(); i++)
        add_run(out, pieces[i].log, pieces[i].begin, pieces[i].end, pieces[i].q,
                y((long)i) - r.value(1) * x((long)i, 1), r.residual((long)i));
    double moment = r.value(0), error = std::sqrt(r.covariance(0, 0));
    add_quantity(out, "p2", "u", moment, error, m.parameter[1]);
    add_quantity(out, "p4", "u", r.value(1), std::sqrt(r.covariance(1, 1)), m.parameter[3]);
    add_quantity(out, "p2 times u_to_torque", "N m", moment * m.u_to_torque, error * m.u_to_torque,
                 problem.options.known > 0.0 ? problem.options.known
                                             : std::numeric_limits<double>::quiet_NaN());
    out.model.parameter[1] = moment;
    out.model.parameter_stderr[1] = error;
    if (!(problem.options.known > 0.0)) {
        add_warning(out, "the torque constant needs m g l in N m, weighed and measured (--known)");
        return MK_OK;
    }
    double k = problem.options.known / moment, k_error = k * error / moment;
    add_quantity(out, "torque constant", "N m", k, k_error, m.u_to_torque);
    return MK_OK;
}

} // namespace

const Measure measure_torque = {{"torque", "torque constant, from a slow sweep against gravity",
                                 "report 3.2", plants_measured_by("torque"), "angle", "rad",
                                 "holding command", "u", "m g l, N m"},
                                run};

} // namespace mk

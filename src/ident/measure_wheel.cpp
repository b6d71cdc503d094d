// The inertia wheel: friction from constant speeds, inertia from constant accelerations.
#include <algorithm>
#include <cmath>
#include <limits>

#include "ident/measure.hpp"

namespace mk
{

namespace
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();
constexpr double PIECE_S = 0.5;
// Below this speed the smoothed sign of the friction law is not yet one: tanh(3) = 0.995.
double slowest(const mk_model &m)
{
    return 3.0 / m.friction_sharpness;
}

double inertia_of(const mk_model &m)
{
    return m.parameter[0];
}

// The whole piece turns one way, at one acceleration.
bool turns(const mk_model &m, const Section &p)
{
    double count = mk_model_count(&m, 0);
    return p.misfit < 2.0 * count && p.v_begin * p.v_end > 0.0 &&
           std::fabs(p.v_begin) > slowest(m) && std::fabs(p.v_end) > slowest(m);
}

// The speed hardly changes: acceleration takes little of the torque.
bool steady(const mk_model &m, const Section &p)
{
    return turns(m, p) &&
           std::fabs(p.v_end - p.v_begin) <
               0.02 * std::fabs(p.v) + 0.1 * mk_model_joint_scale(&m, 0) &&
           std::fabs(inertia_of(m) * p.a) < 0.1 * std::fabs(p.u);
}

// A ramp: the command is not at its limit, and acceleration is what takes the torque.
bool ramps(const mk_model &m, const Section &p)
{
    return turns(m, p) && std::fabs(p.u) < 0.98 * m.u_max &&
           std::fabs(inertia_of(m) * p.a) > 0.1 * std::fabs(p.u) &&
           std::fabs(p.a) * PIECE_S > mk_model_joint_scale(&m, 0);
}

// Row of the law that both ways have a Coulomb and a viscous part of their own.
void friction_row(double v, double *row)
{
    row[0] = v > 0.0 ? 1.0 : 0.0;
    row[1] = v > 0.0 ? v : 0.0;
    row[2] = v > 0.0 ? 0.0 : -1.0;
    row[3] = v > 0.0 ? 0.0 : v;
}

struct Ways {
    int forwards = 0, backwards = 0;
};

Ways count_ways(const std::vector<Section> &pieces)
{
    Ways w;
    for (const Section &p : pieces)
        (p.v > 0.0 ? w.forwards : w.backwards)++;
    return w;
}

void spread_of_speeds(const std::vector<Section> &pieces, double sign, double &low, double &high)
{
    low = HUGE_VAL;
    high = 0.0;
    for (const Section &p : pieces)
        if (p.v * sign > 0.0) {
            low = std::min(low, std::fabs(p.v));
            high = std::max(high, std::fabs(p.v));
        }
}

void report_friction(const mk_model &given, const Regressed &r, mk_measurement &out)
{
    static const struct {
        const char *name, *unit;
        int parameter;
    } rows[4] = {{"coulomb forwards", "N m", 2},
                 {"viscous forwards", "N m s/rad", 1},
                 {"coulomb backwards", "N m", 2},
                 {"viscous backwards", "N m s/rad", 1}};
    for (int i = 0; i < 4; i++)
        add_quantity(out, rows[i].name, mk_model_unit(&given, 0, rows[i].unit), r.value(i),
                     std::sqrt(r.covariance(i, i)), given.parameter[rows[i].parameter]);
    auto pair = [&](int i, int k, double sign) {
        return std::sqrt(r.covariance(i, i) + r.covariance(k, k) + 2.0 * sign * r.covariance(i, k));
    };
    double coulomb = 0.5 * (r.value(0) + r.value(2)), viscous = 0.5 * (r.value(1) + r.value(3));
    add_quantity(out, "p3, mean of both ways", mk_model_unit(&given, 0, "N m"), coulomb,
                 0.5 * pair(0, 2, 1.0), given.parameter[2]);
    add_quantity(out, "p2, mean of both ways", mk_model_unit(&given, 0, "N m s/rad"), viscous,
                 0.5 * pair(1, 3, 1.0), given.parameter[1]);
    double difference = r.value(0) - r.value(2);
    add_quantity(out, "coulomb-asymmetry", mk_model_unit(&given, 0, "N m"), difference,
                 pair(0, 2, -1.0), UNKNOWN);
    out.model.parameter[1] = viscous;
    out.model.parameter_stderr[1] = 0.5 * pair(1, 3, 1.0);
    out.model.parameter[2] = coulomb;
    out.model.parameter_stderr[2] = 0.5 * pair(0, 2, 1.0);
    // Kept in the model where it is more than its error.
    if (std::fabs(difference) > 3.0 * pair(0, 2, -1.0) &&
        mk_model_add_effect(&out.model, "coulomb-asymmetry", 1, nullptr) == MK_OK)
        out.model.effect[out.model.effect_count - 1].value[0] = difference;
}

enum mk_status run_friction(const MeasureProblem &problem, mk_measurement &out, mk_error *err)
{
    std::vector<Section> pieces;
    for (const Section &p : cut(problem, PIECE_S))
        if (steady(problem.model, p))
            pieces.push_back(p);
    Ways ways = count_ways(pieces);
    if (ways.forwards < 3 || ways.backwards < 3)
        return mk_error_set(err, MK_ERR_RANGE,
                            "%d pieces of %g s at constant speed forwards, %d backwards: 3 each "
                            "are needed, at two speeds or more",
                            ways.forwards, PIECE_S, ways.backwards);
    for (double sign : {1.0, -1.0}) {
        double low, high;
        spread_of_speeds(pieces, sign, low, high);
        if (high < 1.5 * low)
            return mk_error_set(err, MK_ERR_RANGE,
                                "%s there is one speed only, %.3g %s: two that differ by half "
                                "tell viscous from Coulomb friction",
                                sign > 0.0 ? "forwards" : "backwards", sign * high,
                                mk_model_unit(&problem.model, 0, "rad/s"));
    }
    MatrixXd x((long)pieces.size(), 4);
    VectorXd y((long)pieces.size());
    for (size_t i = 0; i < pieces.size(); i++) {
        double row[4];
        friction_row(pieces[i].v, row);
        x.row((long)i) = Eigen::Map<Eigen::RowVector4d>(row);
        y((long)i) = pieces[i].u - inertia_of(problem.model) * pieces[i].a;
    }
    Regressed r = regress_plain(x, y);
    if (!r.determined)
        return mk_error_set(err, MK_ERR_RANGE, "the speeds do not tell friction's parts apart");
    for (size_t i = 0; i < pieces.size(); i++)
        add_run(out, pieces[i].log, pieces[i].begin, pieces[i].end, pieces[i].v, y((long)i),
                r.residual((long)i));
    report_friction(problem.model, r, out);
    return MK_OK;
}

// Friction over a piece as the model has it.
double model_friction(const mk_model &m, const Section &p)
{
    return mk_plant_friction(&m, p.v);
}

// As the report: the model's friction taken off, each ramp gives a value.
void inertia_by_model(const MeasureProblem &problem, const std::vector<Section> &pieces,
                      mk_measurement &out)
{
    MatrixXd x((long)pieces.size(), 1);
    VectorXd y((long)pieces.size());
    for (size_t i = 0; i < pieces.size(); i++) {
        x((long)i, 0) = pieces[i].a;
        y((long)i) = pieces[i].u - model_friction(problem.model, pieces[i]);
    }
    Regressed r = regress_plain(x, y);
    add_quantity(out, "p1 with the model's friction", mk_model_unit(&problem.model, 0, "kg m^2"),
                 r.value(0), std::sqrt(r.covariance(0, 0)), problem.model.parameter[0]);
}

void report_constant(const MeasureProblem &problem, double j, double error, mk_measurement &out)
{
    const mk_model &m = problem.model;
    add_quantity(out, "p1 times u_to_torque", m.joint_linear[0] ? "kg" : "kg m^2",
                 j * m.u_to_torque, error * m.u_to_torque,
                 problem.options.known > 0.0 ? problem.options.known : UNKNOWN);
    if (problem.options.known > 0.0)
        add_quantity(out, m.joint_linear[0] ? "force constant" : "torque constant",
                     m.joint_linear[0] ? "N" : "N m", problem.options.known / j,
                     problem.options.known * error / (j * j), m.u_to_torque);
}

// Pieces with a constant acceleration, and with them those at constant speed.
void find_ramps(const MeasureProblem &problem, std::vector<Section> &ramping,
                std::vector<Section> &all)
{
    for (const Section &p : cut(problem, PIECE_S)) {
        const bool ramp = ramps(problem.model, p);
        if (ramp || steady(problem.model, p))
            all.push_back(p);
        if (ramp)
            ramping.push_back(p);
    }
}

// u = J a + friction(v): inertia and friction of the same runs. Friction both ways, or of the way
// that most runs go where the other has too few.
void inertia_equations(const std::vector<Section> &pieces, MatrixXd &x, VectorXd &y)
{
    const Ways ways = count_ways(pieces);
    const bool both = ways.forwards > 2 && ways.backwards > 2;
    const int first = both || ways.forwards > ways.backwards ? 0 : 2, terms = both ? 4 : 2;
    x.resize((long)pieces.size(), 1 + terms);
    y.resize((long)pieces.size());
    for (size_t i = 0; i < pieces.size(); i++) {
        double row[4];
        friction_row(pieces[i].v, row);
        x((long)i, 0) = pieces[i].a;
        for (int k = 0; k < terms; k++)
            x((long)i, 1 + k) = row[first + k];
        y((long)i) = pieces[i].u;
    }
}

enum mk_status run_inertia(const MeasureProblem &problem, mk_measurement &out, mk_error *err)
{
    std::vector<Section> all, ramping;
    find_ramps(problem, ramping, all);
    if (ramping.size() < 4)
        return mk_error_set(err, MK_ERR_RANGE,
                            "%zu pieces of %g s with a constant acceleration: 4 are needed",
                            ramping.size(), PIECE_S);
    inertia_by_model(problem, ramping, out);
    // Better: friction found along with it, from the same runs.
    MatrixXd x;
    VectorXd y;
    inertia_equations(all, x, y);
    Regressed r = regress_plain(x, y);
    if (!r.determined)
        return mk_error_set(err, MK_ERR_RANGE,
                            "the ramps do not tell inertia from friction: give more of them, up "
                            "and down");
    for (size_t i = 0; i < all.size(); i++)
        add_run(out, all[i].log, all[i].begin, all[i].end, all[i].a,
                (y((long)i) - x.row((long)i).tail(x.cols() - 1).dot(r.value.tail(x.cols() - 1))),
                r.residual((long)i));
    double j = r.value(0), error = std::sqrt(r.covariance(0, 0));
    add_quantity(out, "p1", mk_model_unit(&problem.model, 0, "kg m^2"), j, error,
                 problem.model.parameter[0]);
    report_constant(problem, j, error, out);
    out.model.parameter[0] = j;
    out.model.parameter_stderr[0] = error;
    const mk_quantity &first = out.quantity[0];
    if (std::fabs(first.value - j) > 3.0 * std::hypot(first.std_error, error))
        add_warning(out, "the model's friction is not that of these runs: measure friction first");
    return MK_OK;
}

} // namespace

const Measure measure_friction = {
    {"friction", "Coulomb and viscous friction both ways, from runs at constant speed",
     "report 2.1, (2.4)", plants_measured_by("friction"), "speed", "rad/s", "friction", "u",
     nullptr},
    run_friction};
const Measure measure_inertia = {{"inertia",
                                  "inertia of the wheel, from runs at constant acceleration",
                                  "report 2.1", plants_measured_by("inertia"), "acceleration",
                                  "rad/s^2", "accelerating torque", "u", "inertia, kg m^2"},
                                 run_inertia};

} // namespace mk

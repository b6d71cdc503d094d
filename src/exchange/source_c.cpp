// A model as C: its equations, and an integrator that finds the instants at which contact opens and
// closes.
#include <cmath>

#include "exchange/source_text.hpp"
#include "sim/predict.h"

namespace mk
{
namespace
{

const char *const header_text = R"(/* @WHAT@. Written by mechkit @VERSION@.
 *
 *     struct @NAME@ s;
 *     @NAME@_init(&s);                    parameters as exported; change s.p[] now
 *     @NAME@_start(&s, q, v);             joints at q [rad], v [rad/s], effects at rest
 *     for (;;) {
 *         @NAME@_measure(&s, y);          what the encoders read [rad]
 *         @NAME@_advance(&s, t_end, u);   s.t [s] to t_end while the command is u
 *     }
 *
 * u[0] is the motor's command, in units of @TORQUE@ N m; u[1] a torque on joint 2 where the rig has
 * a second motor. No allocation, no globals: any number of rigs, in any number of threads.
 */
#ifndef @UPPER@_H
#define @UPPER@_H

enum {
    @UPPER@_JOINTS = @JOINTS@,
    @UPPER@_STATES = @STATES@,
    @UPPER@_SURFACES = @SURFACES@,   /* where contact opens or closes */
    @UPPER@_PARAMETERS = @PARAMETERS@,
    @UPPER@_LATE = @LATE@,           /* commands under way in an input delay */
    @UPPER@_PAST = @PAST@            /* states remembered for a sensor delay */
};

struct @NAME@ {
    double p[@UPPER@_PARAMETERS];    /* @NAME@_parameter_names */
    double t, x[@UPPER@_STATES];     /* @NAME@_state_names */
    double u[2];                     /* command in force */
    double rtol, atol;
    double step;                     /* the integrator's own, 0: not known yet */
    double issued[2];                /* newest command, perhaps not in force yet */
    int first, waiting;              /* ring of commands under way */
    double late_t[@UPPER@_LATE], late_u[@UPPER@_LATE][2];
    int next, remembered;            /* ring of states */
    double past_t[@UPPER@_PAST], past_x[@UPPER@_PAST][@UPPER@_STATES];
};

extern const char *const @NAME@_state_names[@UPPER@_STATES];
extern const char *const @NAME@_parameter_names[@UPPER@_PARAMETERS];

void @NAME@_init(struct @NAME@ *s);
void @NAME@_start(struct @NAME@ *s, const double *q, const double *v);
/* From any state x at time t. */
void @NAME@_start_at(struct @NAME@ *s, double t, const double *x);
/* 0, or -1 where the state leaves every bound. */
int @NAME@_advance(struct @NAME@ *s, double t_end, const double *u);
void @NAME@_measure(const struct @NAME@ *s, double *y);

/* The equations alone: without delays, p the parameters. */
void @NAME@_rhs(const double *p, double t, const double *x, const double *u, double *dx);
void @NAME@_readings(const double *p, double t, const double *x, double *y);
void @NAME@_surfaces(const double *p, double t, const double *x, double *g);
void @NAME@_at_rest(const double *p, const double *q, const double *v, double *x);

#endif
)";

const char *const equations_text = R"(/* @WHAT@. Written by mechkit @VERSION@. */
#include "@NAME@.h"

#include <math.h>
#include <string.h>

const char *const @NAME@_state_names[@UPPER@_STATES] = {@STATE_NAMES@};
const char *const @NAME@_parameter_names[@UPPER@_PARAMETERS] = {@PARAMETER_NAMES@};

static const double exported[@UPPER@_PARAMETERS] = {
@VALUES@};

void @NAME@_rhs(const double *p, double t, const double *x, const double *u, double *dx)
{
    (void)p, (void)t, (void)u;
@RHS@}

void @NAME@_readings(const double *p, double t, const double *x, double *y)
{
    (void)p, (void)t;
@READINGS@}

void @NAME@_surfaces(const double *p, double t, const double *x, double *g)
{
    (void)p, (void)t, (void)x, (void)g;
@EVENTS@}

void @NAME@_at_rest(const double *p, const double *q, const double *v, double *x)
{
    (void)p;
@REST@}
)";

const char *const runtime_text = R"(
/* --- integration: Dormand and Prince, 5(4) --------------------------------------------------- */

static const double command_delay = @COMMAND_DELAY@;
static const double sensor_delay[2] = {@SENSOR_DELAY@};

void @NAME@_init(struct @NAME@ *s)
{
    memset(s, 0, sizeof *s);
    memcpy(s->p, exported, sizeof exported);
    s->rtol = @RTOL@;
    s->atol = @ATOL@;
}

/* A caller that takes tiny steps does not push out what the delay still needs. */
static void remember(struct @NAME@ *s)
{
    if (@UPPER@_PAST == 1)
        return;
    double oldest = sensor_delay[0] > sensor_delay[1] ? sensor_delay[0] : sensor_delay[1];
    int newest = (s->next + @UPPER@_PAST - 1) % @UPPER@_PAST;
    int before = (s->next + @UPPER@_PAST - 2) % @UPPER@_PAST;
    if (s->remembered > 1 && s->past_t[newest] - s->past_t[before] < 2.0 * oldest / @UPPER@_PAST) {
        s->next = newest;
        s->remembered--;
    }
    s->past_t[s->next] = s->t;
    memcpy(s->past_x[s->next], s->x, sizeof s->x);
    s->next = (s->next + 1) % @UPPER@_PAST;
    if (s->remembered < @UPPER@_PAST)
        s->remembered++;
}

void @NAME@_start_at(struct @NAME@ *s, double t, const double *x)
{
    s->t = t;
    memcpy(s->x, x, sizeof s->x);
    s->u[0] = s->u[1] = s->issued[0] = s->issued[1] = 0.0;
    s->step = 0.0;
    s->first = s->waiting = s->next = s->remembered = 0;
    remember(s);
}

void @NAME@_start(struct @NAME@ *s, const double *q, const double *v)
{
    double x[@UPPER@_STATES];
    @NAME@_at_rest(s->p, q, v, x);
    @NAME@_start_at(s, 0.0, x);
}

/* One step of length h from s; k1 is the slope there. Returns the error over what is tolerated;
 * above 1 the step is too long. */
static double attempt(const struct @NAME@ *s, const double *k1, double h, double *next,
                      double *slope)
{
    static const double a[6][6] = {
        {1.0 / 5},
        {3.0 / 40, 9.0 / 40},
        {44.0 / 45, -56.0 / 15, 32.0 / 9},
        {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
        {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
        {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84}};
    static const double c[6] = {1.0 / 5, 3.0 / 10, 4.0 / 5, 8.0 / 9, 1, 1};
    static const double e[7] = {71.0 / 57600,      0,          -71.0 / 16695, 71.0 / 1920,
                                -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
    double k[7][@UPPER@_STATES], worst = 0.0;
    memcpy(k[0], k1, sizeof k[0]);
    for (int stage = 0; stage < 6; stage++) {
        for (int i = 0; i < @UPPER@_STATES; i++) {
            double sum = 0.0;
            for (int j = 0; j <= stage; j++)
                sum += a[stage][j] * k[j][i];
            next[i] = s->x[i] + h * sum;
        }
        @NAME@_rhs(s->p, s->t + c[stage] * h, next, s->u, k[stage + 1]);
    }
    for (int i = 0; i < @UPPER@_STATES; i++) {
        double error = 0.0;
        for (int j = 0; j < 7; j++)
            error += e[j] * k[j][i];
        error = fabs(h * error) / (s->atol + s->rtol * fmax(fabs(s->x[i]), fabs(next[i])));
        worst = error <= worst ? worst : error; /* NaN wins */
    }
    memcpy(slope, k[6], sizeof k[6]);
    return worst;
}

#if @SURFACES@ > 0
static int crossed(const struct @NAME@ *s, const double *before, double h, const double *x)
{
    double now[@UPPER@_SURFACES];
    @NAME@_surfaces(s->p, s->t + h, x, now);
    for (int i = 0; i < @UPPER@_SURFACES; i++)
        if ((now[i] > 0.0) != (before[i] > 0.0))
            return 1;
    return 0;
}

/* Shortens a step that passes a surface so that it ends just beyond the first. */
static double up_to_surface(const struct @NAME@ *s, const double *k1, double *h, double *next,
                            double *slope, double error)
{
    double before[@UPPER@_SURFACES], low = 0.0, high = *h;
    @NAME@_surfaces(s->p, s->t, s->x, before);
    if (!crossed(s, before, *h, next))
        return error;
    while (high - low > 1e-14 * fmax(1.0, fabs(s->t))) {
        double middle = 0.5 * (low + high);
        attempt(s, k1, middle, next, slope);
        if (crossed(s, before, middle, next))
            high = middle;
        else
            low = middle;
    }
    *h = high;
    return attempt(s, k1, high, next, slope);
}
#endif

static int run_to(struct @NAME@ *s, double t_end)
{
    double k1[@UPPER@_STATES], next[@UPPER@_STATES], slope[@UPPER@_STATES];
    double resolution = 1e-13 * fmax(1.0, fabs(t_end));
    @NAME@_rhs(s->p, s->t, s->x, s->u, k1);
    if (!(s->step > 0.0))
        s->step = 0.1 * (t_end - s->t);
    for (long tries = 0; t_end - s->t > resolution; tries++) {
        double left = t_end - s->t, h = s->step < left ? s->step : left;
        double error = attempt(s, k1, h, next, slope);
#if @SURFACES@ > 0
        error = up_to_surface(s, k1, &h, next, slope, error);
#endif
        double factor = error > 0.0 ? 0.9 * pow(error, -0.2) : 5.0;
        if (!(error <= 1.0)) {
            s->step = h * (factor > 0.1 ? factor : 0.1);
            if (tries > 2000000 || !(s->step > 1e-15))
                return -1;
            continue;
        }
        /* A step that the end or a surface cut short says little about how long it could be. */
        if (h == s->step || factor < 1.0)
            s->step = h * (factor < 5.0 ? factor : 5.0);
        s->t = h == left ? t_end : s->t + h;
        memcpy(s->x, next, sizeof s->x);
        memcpy(k1, slope, sizeof k1);
    }
    s->t = t_end;
    remember(s);
    return 0;
}

int @NAME@_advance(struct @NAME@ *s, double t_end, const double *u)
{
    double two[2] = {u[0], @SECOND_INPUT@};
    int failed = 0;
    if (command_delay <= 0.0) {
        memcpy(s->u, two, sizeof two);
    } else if (two[0] != s->issued[0] || two[1] != s->issued[1]) {
        int last = (s->first + s->waiting++) % @UPPER@_LATE;
        if (s->waiting > @UPPER@_LATE)
            return -1;
        s->late_t[last] = s->t + command_delay;
        memcpy(s->late_u[last], two, sizeof two);
        memcpy(s->issued, two, sizeof two);
    }
    while (!failed && s->waiting > 0 && s->late_t[s->first] <= t_end) {
        int now = s->first;
        s->first = (s->first + 1) % @UPPER@_LATE;
        s->waiting--;
        failed = run_to(s, s->late_t[now]);
        memcpy(s->u, s->late_u[now], sizeof s->u);
    }
    return failed ? failed : run_to(s, t_end);
}

/* The state at time t in the past: cubic in the angles, linear in the rest. Before the start the
 * rig is taken to have moved evenly. */
static void recall(const struct @NAME@ *s, double t, double *x)
{
    int before = -1, after = -1;
    for (int i = 1; i <= s->remembered && before < 0; i++) {
        int at = (s->next + @UPPER@_PAST - i) % @UPPER@_PAST;
        if (s->past_t[at] <= t)
            before = at;
        else
            after = at;
    }
    int only = before >= 0 ? before : after;
    double dt = t - s->past_t[only];
    memcpy(x, s->past_x[only], sizeof s->x);
    if (before < 0 || after < 0) {
        for (int j = 0; j < @UPPER@_JOINTS; j++)
            x[j] += dt * x[@UPPER@_JOINTS + j];
        return;
    }
    const double *a = s->past_x[before], *b = s->past_x[after];
    double h = s->past_t[after] - s->past_t[before], f = dt / h, r = 1.0 - f;
    for (int i = 0; i < @UPPER@_STATES; i++)
        x[i] = r * a[i] + f * b[i];
    for (int j = 0; j < @UPPER@_JOINTS; j++)
        x[j] = (1.0 + 2.0 * f) * r * r * a[j] + f * f * (3.0 - 2.0 * f) * b[j] +
               h * f * r * (r * a[@UPPER@_JOINTS + j] - f * b[@UPPER@_JOINTS + j]);
}

void @NAME@_measure(const struct @NAME@ *s, double *y)
{
    @NAME@_readings(s->p, s->t, s->x, y);
    for (int j = 0; j < @UPPER@_JOINTS; j++) {
        double x[@UPPER@_STATES], then[@UPPER@_JOINTS];
        if (!(sensor_delay[j] > 0.0))
            continue;
        recall(s, s->t - sensor_delay[j], x);
        @NAME@_readings(s->p, s->t - sensor_delay[j], x, then);
        y[j] = then[j];
    }
}
)";

std::string strings(const std::vector<std::string> &texts)
{
    std::string out;
    for (const std::string &t : texts)
        out += (out.empty() ? "\"" : ", \"") + t + "\"";
    return out;
}

std::string local(const std::string &name, const std::string &from)
{
    return "    const double " + name + " = " + from + ";\n";
}

std::string element(const char *array, size_t index)
{
    return std::string(array) + "[" + std::to_string(index) + "]";
}

// Locals for the variables that the assignments need, then the assignments.
std::string body(const SymbolicModel &s, const std::vector<Assignment> &assignments,
                 bool state_is_q_and_v = false)
{
    std::string out;
    size_t n = static_cast<size_t>(s.joints);
    for (size_t i = 0; i < s.state_names.size(); i++)
        if (needs(s.graph, assignments, s.state_names[i]))
            out += local(s.state_names[i], !state_is_q_and_v ? element("x", i)
                                           : i < n           ? element("q", i)
                                                             : element("v", i - n));
    for (const char *input : {"u1", "u2"})
        if (needs(s.graph, assignments, input))
            out += local(input, element("u", input[1] == '1' ? 0 : 1));
    for (size_t i = 0; i < s.parameters.size(); i++)
        if (needs(s.graph, assignments, s.parameters[i].name))
            out += local(s.parameters[i].name, element("p", i));
    return out + statements(s.graph, Language::C, assignments);
}

std::vector<Assignment> elements(const char *target, const std::vector<Expr> &values)
{
    std::vector<Assignment> out;
    for (size_t i = 0; i < values.size(); i++)
        out.push_back({element(target, i), values[i]});
    return out;
}

std::string values_of(const SymbolicModel &s)
{
    std::string out;
    for (const ExportedParameter &p : s.parameters)
        out += "    " + literal(p.value) + ", /* " + p.name +
               (p.unit.empty() ? "" : " [" + p.unit + "]") + ": " + p.help + " */\n";
    return out;
}

std::vector<std::pair<std::string, std::string>> words(const SymbolicModel &s,
                                                       const std::string &name)
{
    std::vector<std::string> parameter_names;
    for (const ExportedParameter &p : s.parameters)
        parameter_names.push_back(p.name);
    double rtol, atol;
    mk_free_run_tolerances(&s.model, &rtol, &atol);
    bool late = s.command_delay > 0.0;
    bool old = s.sensor_delay[0] > 0.0 || s.sensor_delay[1] > 0.0;
    return {{"NAME", name},
            {"UPPER", upper(name)},
            {"WHAT", describe(s)},
            {"VERSION", MK_VERSION},
            {"TORQUE", literal(s.model.u_to_torque)},
            {"JOINTS", std::to_string(s.joints)},
            {"STATES", std::to_string(s.states)},
            {"SURFACES", std::to_string(s.events)},
            {"PARAMETERS", std::to_string(s.parameters.size())},
            {"LATE", late ? "4096" : "1"},
            {"PAST", old ? "2048" : "1"},
            {"STATE_NAMES", strings(s.state_names)},
            {"PARAMETER_NAMES", strings(parameter_names)},
            {"VALUES", values_of(s)},
            {"RHS", body(s, elements("dx", s.dx))},
            {"READINGS", body(s, elements("y", s.readings))},
            {"EVENTS", body(s, elements("g", s.surfaces))},
            {"REST", body(s, elements("x", s.at_rest), true)},
            {"COMMAND_DELAY", literal(s.command_delay)},
            {"SENSOR_DELAY", literal(s.sensor_delay[0]) + ", " + literal(s.sensor_delay[1])},
            {"SECOND_INPUT", s.two_inputs ? "u[1]" : "0.0"},
            {"RTOL", literal(std::fmin(rtol, 1e-9))},
            {"ATOL", literal(std::fmin(atol, 1e-11))}};
}

} // namespace

std::string c_header(const SymbolicModel &s, const std::string &name)
{
    return fill(header_text, words(s, name));
}

std::string c_source(const SymbolicModel &s, const std::string &name)
{
    auto all = words(s, name);
    return fill(equations_text, all) + fill(runtime_text, all);
}

} // namespace mk

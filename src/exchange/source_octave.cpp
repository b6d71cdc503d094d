// A model as a function file that Octave and MATLAB run.
#include "exchange/source_text.hpp"

namespace mk
{
namespace
{

const char *const frame_text = R"(function [dx, y, mass] = @NAME@(t, x, u, p)
%@UPPER@  @WHAT@.
%   dx = @NAME@(t, x, u)        derivative of the state x at time t [s] under the command u
%   [dx, y, mass] = @NAME@(...) also what the encoders read [rad], and the mass matrix
%   ... = @NAME@(t, x, u, p)    with other parameters, in the order of info.parameter_names
%   info = @NAME@()             names, numbers and units
%   x = @NAME@('state', q, v)   state with the joints at q [rad], v [rad/s] and effects at rest
%
%   Written by mechkit @VERSION@. Torques are in units of @TORQUE@ N m.@DELAYS@
  if nargin == 0
    dx = describe();
    return
  end
  if nargin < 4
    p = @P@;
  end
  if ischar(t)
    dx = at_rest(x, u, p);
    return
  end
@INPUTS@@RHS@  if nargout > 1
    y = readings(t, x, p);
  end
  if nargout > 2
    mass = mass_matrix(t, x, p);
  end
end

function y = readings(t, x, p) %#ok<INUSL>
@READINGS@end

function mass = mass_matrix(t, x, p) %#ok<INUSL>
@MASS@end

function x = at_rest(q, v, p) %#ok<INUSD>
  if numel(v) == 1
    v = v * ones(@JOINTS@, 1);
  end
@REST@end

function info = describe()
  info.rig = '@RIG@';
  info.joints = @JOINTS@;
  info.rest = @HANGING@;
  info.u_max = @U_MAX@;
  info.u_to_torque = @TORQUE@;
  info.command_delay = @COMMAND_DELAY@;
  info.sensor_delay = @SENSOR_DELAY@;
  info.state_names = @STATE_NAMES@;
  info.parameter_names = @PARAMETER_NAMES@;
  info.parameter_units = @PARAMETER_UNITS@;
  info.p = @P@;
end
)";

std::string cells(const std::vector<std::string> &texts)
{
    std::string out = "{";
    for (const std::string &t : texts)
        out += (out.size() > 1 ? ", '" : "'") + t + "'";
    return out + "}";
}

std::string column(const std::vector<double> &values)
{
    std::string out = "[";
    for (double v : values)
        out += (out.size() > 1 ? "; " : "") + literal(v);
    return out + "]";
}

// "    q1 = x(1);" for each variable that the assignments need, then the assignments.
std::string body(const SymbolicModel &s, const std::vector<Assignment> &assignments,
                 bool state_is_q_and_v = false)
{
    std::string out;
    for (size_t i = 0; i < s.state_names.size(); i++) {
        size_t n = static_cast<size_t>(s.joints);
        std::string from = "x(" + std::to_string(i + 1) + ")";
        if (state_is_q_and_v)
            from =
                i < n ? "q(" + std::to_string(i + 1) + ")" : "v(" + std::to_string(i - n + 1) + ")";
        if (needs(s.graph, assignments, s.state_names[i]))
            out += "  " + s.state_names[i] + " = " + from + ";\n";
    }
    for (size_t i = 0; i < s.parameters.size(); i++)
        if (needs(s.graph, assignments, s.parameters[i].name))
            out += "  " + s.parameters[i].name + " = p(" + std::to_string(i + 1) + "); % " +
                   s.parameters[i].help + "\n";
    return out + statements(s.graph, Language::Octave, assignments);
}

std::vector<Assignment> elements(const char *target, const std::vector<Expr> &values)
{
    std::vector<Assignment> out;
    for (size_t i = 0; i < values.size(); i++)
        out.push_back({std::string(target) + "(" + std::to_string(i + 1) + ", 1)", values[i]});
    return out;
}

std::vector<Assignment> matrix_elements(const SymbolicModel &s)
{
    std::vector<Assignment> out;
    for (int i = 0; i < s.joints; i++)
        for (int j = 0; j < s.joints; j++)
            out.push_back({"mass(" + std::to_string(i + 1) + ", " + std::to_string(j + 1) + ")",
                           s.mass[static_cast<size_t>(i * s.joints + j)]});
    return out;
}

std::string inputs(const SymbolicModel &s, const std::vector<Assignment> &assignments)
{
    std::string out;
    if (needs(s.graph, assignments, "u1"))
        out += "  u1 = u(1);\n";
    if (needs(s.graph, assignments, "u2"))
        out += "  u2 = 0;\n  if numel(u) > 1\n    u2 = u(2);\n  end\n";
    return out;
}

} // namespace

std::string octave_source(const SymbolicModel &s, const std::string &name)
{
    std::vector<Assignment> rhs = elements("dx", s.dx);
    std::vector<std::string> names, units;
    std::vector<double> values;
    for (const ExportedParameter &p : s.parameters) {
        names.push_back(p.name);
        units.push_back(p.unit);
        values.push_back(p.value);
    }
    std::string delays;
    if (s.command_delay > 0.0 || s.sensor_delay[0] > 0.0 || s.sensor_delay[1] > 0.0)
        delays = "\n%   Delays are not in dx and y: mk_simulate applies info.command_delay and "
                 "info.sensor_delay.";
    std::vector<double> rest(s.plant->rest, s.plant->rest + s.joints);
    std::vector<double> ages(s.sensor_delay, s.sensor_delay + s.joints);
    return fill(frame_text, {{"NAME", name},
                             {"UPPER", upper(name)},
                             {"WHAT", describe(s)},
                             {"VERSION", MK_VERSION},
                             {"TORQUE", literal(s.model.u_to_torque)},
                             {"DELAYS", delays},
                             {"P", column(values)},
                             {"INPUTS", inputs(s, rhs)},
                             {"RHS", body(s, rhs)},
                             {"READINGS", body(s, elements("y", s.readings))},
                             {"MASS", body(s, matrix_elements(s))},
                             {"REST", body(s, elements("x", s.at_rest), true)},
                             {"JOINTS", std::to_string(s.joints)},
                             {"RIG", s.plant->name},
                             {"HANGING", column(rest)},
                             {"U_MAX", literal(s.model.u_max)},
                             {"COMMAND_DELAY", literal(s.command_delay)},
                             {"SENSOR_DELAY", column(ages)},
                             {"STATE_NAMES", cells(s.state_names)},
                             {"PARAMETER_NAMES", cells(names)},
                             {"PARAMETER_UNITS", cells(units)}});
}

} // namespace mk

#include "exchange/symbolic.hpp"

#include "mechkit/ident.h"
#include "model/state.hpp"

namespace mk
{
namespace
{

std::string identifier(const std::string &text)
{
    std::string out;
    for (char c : text)
        out += (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ? c : '_';
    return out;
}

// "backlash", or "viscous_2" for the second of a name, as in model files.
std::string effect_name(const mk_model &model, int index)
{
    int nth = 1;
    for (int i = 0; i < index; i++)
        nth += model.effect[i].index == model.effect[index].index;
    std::string name = identifier(mk_effect(model.effect[index].index)->name);
    return nth == 1 ? name : name + "_" + std::to_string(nth);
}

// `joint`: at which it acts, 0-based; -1: the rig.
Expr parameter(SymbolicModel &s, int joint, const mk_parameter_info &info, const std::string &name,
               double value)
{
    // Says which law, not how much of it, or does nothing here.
    if (info.fit == MK_FIT_FIXED || !mk_parameter_applies(&info, s.model.plant))
        return Expr(value);
    s.parameters.push_back({name, mk_model_unit(&s.model, joint, info.unit), info.help, value});
    return Expr::variable(s.graph, name, value);
}

Compiled<Expr> compile_symbols(SymbolicModel &s)
{
    Compiled<Expr> c = compile<Expr>(s.model);
    for (int i = 0; i < c.parameter_count; i++)
        c.p[i] = parameter(s, s.plant->parameter_joint[i], s.plant->parameter[i],
                           s.plant->parameter[i].name, s.model.parameter[i]);
    for (int i = 0; i < c.effect_count; i++) {
        const mk_effect_info *info = mk_effect(s.model.effect[i].index);
        std::string owner = effect_name(s.model, i) + "_";
        // Delays are numbers of the caller's clockwork, not of the equations.
        if (info->stages == 0 || (info->stages & (MK_STAGE_COMMAND_DELAY | MK_STAGE_SENSOR_DELAY)))
            continue;
        for (int k = 0; k < info->parameter_count; k++)
            c.effect[i].p[k] =
                parameter(s, s.model.effect[i].joint - 1, info->parameter[k],
                          owner + identifier(info->parameter[k].name), s.model.effect[i].value[k]);
    }
    return c;
}

void name_states(SymbolicModel &s)
{
    for (int j = 0; j < s.joints; j++)
        s.state_names.push_back("q" + std::to_string(j + 1));
    for (int j = 0; j < s.joints; j++)
        s.state_names.push_back("dq" + std::to_string(j + 1));
    for (int i = 0; i < s.model.effect_count; i++) {
        int count = mk_effect(s.model.effect[i].index)->state_count;
        for (int k = 0; k < count; k++)
            s.state_names.push_back(effect_name(s.model, i) + "_z" +
                                    (count > 1 ? std::to_string(k + 1) : ""));
    }
}

void find_delays(SymbolicModel &s)
{
    s.command_delay = mk_model_command_delay(&s.model);
    s.sensor_delay[0] = s.sensor_delay[1] = 0.0;
    for (int i = 0; i < s.model.effect_count; i++) {
        const mk_effect_use &use = s.model.effect[i];
        if (!(mk_effect(use.index)->stages & MK_STAGE_SENSOR_DELAY))
            continue;
        for (int j = 0; j < s.joints; j++)
            if (use.joint == 0 || use.joint == j + 1)
                s.sensor_delay[j] += use.value[0];
    }
}

} // namespace

void symbolic_model(const mk_model &model, SymbolicModel &s)
{
    s.model = model;
    s.plant = mk_plant(model.plant);
    s.joints = s.plant->joints;
    s.states = mk_model_state_count(&model);
    s.events = mk_model_event_count(&model);
    s.two_inputs = s.joints == 2 && s.plant->motor_joint == 0;
    find_delays(s);
    name_states(s);
    Compiled<Expr> c = compile_symbols(s);
    Expr t = Expr::variable(s.graph, "t"), x[MK_MAX_STATES];
    Expr u[MK_MAX_INPUTS] = {Expr::variable(s.graph, "u1"),
                             s.two_inputs ? Expr::variable(s.graph, "u2") : Expr(0.0)};
    for (int i = 0; i < s.states; i++)
        x[i] = Expr::variable(s.graph, s.state_names[static_cast<size_t>(i)]);
    Expr dx[MK_MAX_STATES], y[MK_MAX_JOINTS], g[MK_MAX_EVENTS], m[3], rest[MK_MAX_STATES];
    rhs(c, t, x, u, dx);
    measure(c, t, x, y);
    events(c, t, x, g);
    mass_matrix(c, t, x, m);
    initial_state(c, x, x + s.joints, rest);
    s.dx.assign(dx, dx + s.states);
    s.readings.assign(y, y + s.joints);
    s.surfaces.assign(g, g + s.events);
    s.at_rest.assign(rest, rest + s.states);
    if (s.joints == 1)
        s.mass = {m[0]};
    else
        s.mass = {m[0], m[1], m[1], m[2]};
}

} // namespace mk

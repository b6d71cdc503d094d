#include "explain/report/structure.hpp"

#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "explain/search/candidates.hpp"
#include "ident/input_report.h"
#include "model/effects_custom.hpp"

namespace mk
{

namespace
{

// A library term with its joint's variables: 'v' and 'w' are the speeds of the joint and of the
// other, 'q' the angle (of `custom`: from rest), 'a' the sum of both angles.
std::string with_variables(const char *text, int joint, double rest)
{
    std::string s;
    for (const char *c = text; *c; c++) {
        // A letter of a function's name is no variable.
        bool word =
            std::isalpha((unsigned char)c[1]) || (c != text && std::isalpha((unsigned char)c[-1]));
        if (word || !strchr("vwqa", *c)) {
            s += *c;
            continue;
        }
        char one[32];
        int other = 3 - joint;
        if (*c == 'a')
            snprintf(one, sizeof one, "(q1+q2)");
        else if (*c == 'q' && rest != 0.0)
            snprintf(one, sizeof one, "(q%d%+.5g)", joint, -rest);
        else
            snprintf(one, sizeof one, "%s%d", *c == 'q' ? "q" : "dq", *c == 'w' ? other : joint);
        s += one;
    }
    return s;
}

std::string formula_of(const mk_cause &cause, const mk_plant_info &plant)
{
    const double *v = cause.value;
    const mk_effect_info &info = *cause.effect;
    int joint = cause.joint;
    char text[200];
    if (strcmp(info.name, "custom") == 0) {
        std::string term =
            with_variables(Custom::about((int)v[1]).text, joint, plant.rest[joint - 1]);
        snprintf(text, sizeof text, "%+.4g*%s", -v[0], term.c_str());
    } else if (strcmp(info.name, "custom-wave") == 0) {
        std::string term = with_variables(CustomWave::text((int)v[2]), joint, 0.0);
        if ((int)v[2] == CustomWave::IN_TIME)
            snprintf(text, sizeof text, "%+.4g*sin(2*pi*%.4g*t%+.3g)", -v[0], v[3], v[1]);
        else
            snprintf(text, sizeof text, "%+.4g*%s%+.3g)", -v[0], term.c_str(), v[1]);
    } else if (strcmp(info.name, "custom-well") == 0) {
        snprintf(text, sizeof text, "%+.4g*sin(q%d%+.3g)*exp((cos(q%d%+.3g)-1)/%.3g^2)",
                 -v[0] / v[2], joint, -v[1], joint, -v[1], v[2]);
    } else if (strcmp(info.name, "viscous") == 0) {
        snprintf(text, sizeof text, "%+.4g*dq%d", -v[0], joint);
    } else if (strcmp(info.name, "coulomb") == 0) {
        snprintf(text, sizeof text, "%+.4g*sign(dq%d)", -v[0], joint);
    } else if (strcmp(info.name, "quadratic-drag") == 0) {
        snprintf(text, sizeof text, "%+.4g*dq%d*abs(dq%d)", -v[0], joint, joint);
    } else {
        std::string values;
        for (int k = 0; k < info.parameter_count; k++) {
            if (mk_parameter_goes_without_saying(&info.parameter[k], plant.kind))
                continue;
            char one[64];
            snprintf(one, sizeof one, "%s%s=%.4g", k ? ", " : "", info.parameter[k].name, v[k]);
            values += one;
        }
        return "+ " + std::string(info.name) + "(" + values + ")";
    }
    return text;
}

} // namespace

std::string describe_structure(const mk_explanation &e, const mk_plant_info &plant)
{
    // Beside causes that are named, only what has no name.
    const bool named = e.verdict == MK_VERDICT_PARTIAL;
    const int first = named ? e.cause_count - e.piece_count : 0;
    std::string all;
    for (int joint = 0; joint <= MK_MAX_JOINTS; joint++) {
        std::string terms;
        for (int i = first; i < e.cause_count; i++)
            if (e.cause[i].joint == joint)
                terms += (terms.empty() ? "" : " ") + formula_of(e.cause[i], plant);
        if (terms.empty())
            continue;
        if (!all.empty())
            all += "; ";
        all += joint > 0 ? "joint " + std::to_string(joint) + ": " + terms : terms;
    }
    return all.empty() && !named ? "no term of the library explains it" : all;
}

} // namespace mk

void mk_budget_item_name(const mk_explanation *e, const mk_budget_item *item, char *text,
                         size_t size)
{
    if (item->input) {
        mk_input_short(&e->input, text, size);
        return;
    }
    const bool own = item->log_value >= 0;
    const mk_cause &c = own ? e->log_value[item->log_value] : e->cause[item->cause];
    if (mk::is_library(c.effect)) {
        const std::string term = mk::formula_of(c, *mk_plant(e->given.plant));
        snprintf(text, size, "joint %d: %s", c.joint, term.c_str());
        return;
    }
    // What tells its size: the value that differs from log to log, or else the first one fitted.
    int k = 0;
    for (int i = c.effect->parameter_count; i-- > 0;)
        if (own ? c.spread[i] > 0.0 : !std::isnan(c.std_error[i]))
            k = i;
    const mk_parameter_info &p = c.effect->parameter[k];
    const char *unit = mk_effect_parameter_unit(&e->given, c.joint, &p);
    char joint[32] = "", value[64];
    if (c.joint > 0)
        snprintf(joint, sizeof joint, " at joint %d", c.joint);
    if (own)
        snprintf(value, sizeof value, "%.2g", c.spread[k]);
    else if (std::isfinite(c.std_error[k]))
        snprintf(value, sizeof value, "%.3g +- %.1g", c.value[k], c.std_error[k]);
    else
        snprintf(value, sizeof value, "%.3g", c.value[k]);
    snprintf(text, size, own ? "%s%s of each log, %s %s%s%s apart" : "%s%s, %s %s%s%s",
             c.effect->name, joint, p.name, value, unit[0] ? " " : "", unit);
}

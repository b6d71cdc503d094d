#include "ident/scale.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>

namespace mk
{

namespace
{

constexpr double UNKNOWN = std::numeric_limits<double>::quiet_NaN();

// Relative standard error beyond which an inertia is not known, and by how much its ratios must be
// known better for that to be the scale's fault: a tenth leaves out data that tell nothing at all.
constexpr double SCALE_UNKNOWN = 0.3, RATIO_KNOWN = 0.1;

// One factor of a unit, "kg", "m^2": its exponents are added `sign` times.
void add_factor(const char *text, size_t length, int sign, Dimension &d)
{
    const char *power = static_cast<const char *>(std::memchr(text, '^', length));
    const size_t name = power ? (size_t)(power - text) : length;
    const int by = sign * (power ? std::atoi(power + 1) : 1);
    auto is = [&](const char *unit) {
        return std::strlen(unit) == name && std::strncmp(text, unit, name) == 0;
    };
    if (is("N"))
        d.mass += by, d.length += by, d.time -= 2 * by;
    else if (is("kg"))
        d.mass += by;
    else if (is("m"))
        d.length += by;
    else if (is("s"))
        d.time += by;
    else if (is("Hz"))
        d.time -= by;
}

Dimension ratio_of(const mk_model &model, int number, int to)
{
    const Dimension a = dimension_of(mk_model_parameter_info(&model, number, nullptr, 0)->unit);
    const Dimension b = dimension_of(mk_model_parameter_info(&model, to, nullptr, 0)->unit);
    return {a.mass - b.mass, a.length - b.length, a.time - b.time};
}

bool is_inertia(const mk_model &model, int number)
{
    const mk_parameter_info *info = mk_model_parameter_info(&model, number, nullptr, 0);
    return std::strcmp(info->unit, "kg m^2") == 0 && info->min > 0.0;
}

bool is_zero(const mk_record &record)
{
    for (const double *u : record.u)
        for (size_t k = 0; u && k < record.rows; k++)
            if (std::fabs(u[k]) > 0.0)
                return false;
    return true;
}

} // namespace

Dimension dimension_of(const char *unit)
{
    Dimension d;
    int sign = 1;
    for (const char *at = unit; *at;) {
        const size_t length = std::strcspn(at, " /");
        add_factor(at, length, sign, d);
        at += length;
        if (*at == '/')
            sign = -1;
        at += *at != '\0';
    }
    return d;
}

std::string unit_of(const Dimension &d)
{
    const std::pair<const char *, int> parts[] = {{"kg", d.mass}, {"m", d.length}, {"s", d.time}};
    auto factors = [&](int sign) {
        std::string out;
        for (const auto &[name, exponent] : parts)
            if (sign * exponent > 0) {
                out += (out.empty() ? "" : " ") + std::string(name);
                if (sign * exponent > 1)
                    out += "^" + std::to_string(sign * exponent);
            }
        return out;
    };
    const std::string above = factors(1), below = factors(-1);
    return below.empty() ? above : (above.empty() ? "1" : above) + "/" + below;
}

bool scales_with_torque(const mk_model &model, int number)
{
    return dimension_of(mk_model_parameter_info(&model, number, nullptr, 0)->unit).mass == 1;
}

bool is_homogeneous(const mk_model &model)
{
    constexpr double SAME = 1e-9; // relative: rounding of the mass matrix's inverse
    mk_model twice = model;
    for (int i = 0; i < mk_model_parameter_count(&model); i++)
        if (scales_with_torque(model, i))
            mk_model_set_parameter(&twice, i, 2.0 * mk_model_parameter(&model, i));
    // Angles and speeds of all signs, out of step with each other.
    const int joints = mk_model_joints(&model);
    for (int k = 0; k < 12; k++) {
        const double q[] = {std::sin(1.3 * k + 0.3) * 3.0, std::sin(2.1 * k + 1.0) * 3.0};
        const double v[] = {std::sin(0.7 * k + 2.0) * 6.0, std::cos(1.9 * k) * 6.0};
        const double u[MK_MAX_INPUTS] = {0.0, 0.0};
        double x[MK_MAX_STATES], one[MK_MAX_STATES], two[MK_MAX_STATES];
        mk_model_initial_state(&model, q, v, x);
        mk_model_rhs(&model, 0.0, x, u, one);
        mk_model_rhs(&twice, 0.0, x, u, two);
        for (int j = joints; j < 2 * joints; j++)
            if (!(std::fabs(one[j] - two[j]) <= SAME * (1.0 + std::fabs(one[j]))))
                return false;
    }
    return true;
}

int scale_holder(const mk_model &model, const bool *unknown)
{
    int first = -1;
    for (int i = 0; i < mk_plant(model.plant)->parameter_count; i++) {
        if (!is_inertia(model, i))
            continue;
        if (!unknown || !unknown[i])
            return i;
        first = first < 0 ? i : first;
    }
    return first;
}

bool scale_is_held(const mk_model &model, const bool *fixed)
{
    for (int i = 0; i < mk_model_parameter_count(&model); i++)
        if (fixed[i] && scales_with_torque(model, i) && mk_model_parameter(&model, i) != 0.0)
            return true;
    return false;
}

bool scale_is_free(const mk_model &model, const std::vector<mk_record> &records)
{
    return std::all_of(records.begin(), records.end(), is_zero) && is_homogeneous(model);
}

bool scale_was_not_found(const mk_ident_result &r, int holder)
{
    const mk_ident_parameter &h = r.parameter[holder];
    const double scale = h.std_error / std::fabs(h.value);
    if (h.fixed || !(scale > SCALE_UNKNOWN))
        return false;
    bool ratio_known = false;
    const size_t n = (size_t)r.parameter_count;
    for (int i = 0; i < r.parameter_count; i++) {
        const mk_ident_parameter &p = r.parameter[i];
        if (i == holder || p.fixed || p.value == 0.0 || !scales_with_torque(r.model, i))
            continue;
        const double own = p.std_error / std::fabs(p.value);
        const double both = r.covariance[(size_t)i * n + (size_t)holder] / (p.value * h.value);
        // Of the logarithm of p / h.
        const double ratio = std::sqrt(std::max(own * own + scale * scale - 2.0 * both, 0.0));
        ratio_known = ratio_known || ratio < RATIO_KNOWN * scale;
    }
    return ratio_known;
}

void tell_ratios(int holder, mk_ident_result &r)
{
    const mk_ident_parameter &h = r.parameter[holder];
    const double known =
        holder < mk_plant(r.model.plant)->parameter_count ? r.model.parameter_stderr[holder] : 0.0;
    r.scale_free = true;
    r.scale_holder = holder;
    for (int i = 0; i < r.parameter_count; i++) {
        mk_ident_parameter &p = r.parameter[i];
        if (i == holder || p.fixed || !scales_with_torque(r.model, i))
            continue;
        mk_ident_ratio &out = r.ratio[r.ratio_count++];
        const std::string name = std::string(p.name) + "/" + h.name;
        snprintf(out.name, sizeof out.name, "%s", name.c_str());
        snprintf(out.unit, sizeof out.unit, "%s", unit_of(ratio_of(r.model, i, holder)).c_str());
        out.parameter = i;
        out.value = p.value / h.value;
        out.std_error = p.std_error / std::fabs(h.value);
        p.std_error = known > 0.0 ? std::hypot(p.std_error, out.value * known) : UNKNOWN;
        p.crb = p.std_error;
    }
}

} // namespace mk

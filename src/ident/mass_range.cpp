#include "ident/mass_range.hpp"

#include <algorithm>
#include <cmath>

namespace mk
{

namespace
{

// Factor within which two values tell of a mass, and factor beyond them. Of 484 searches in
// measured and made-up data those whose causes are believed took no mass further than 1.17 beyond
// both.
constexpr double AGREE = 1.5, BEYOND = 1.25;
// Standard deviation of the logarithm outside of the range: a wall, and yet smooth to a fit.
constexpr double SOFT = 0.01;

int mass_count(const mk_model &model)
{
    return mk_plant(model.plant)->mass_count;
}

} // namespace

MassRange::MassRange(const mk_model &one, const mk_model &other)
{
    for (int i = 0; i < mass_count(one); i++) {
        const double a = one.parameter[i], b = other.parameter[i];
        if (!(a * b > 0.0) || !(a / b < AGREE && b / a < AGREE))
            continue;
        low[i] = std::min(std::fabs(a), std::fabs(b)) / BEYOND;
        high[i] = std::max(std::fabs(a), std::fabs(b)) * BEYOND;
        sign[i] = a > 0.0 ? 1.0 : -1.0;
    }
}

void MassRange::include(const mk_model &third)
{
    for (int i = 0; i < mass_count(third); i++) {
        const double p = sign[i] * third.parameter[i];
        const double least = low[i] * BEYOND, most = high[i] / BEYOND;
        const bool agrees = p > least / AGREE && p < most * AGREE;
        low[i] = agrees ? std::min(p, least) / BEYOND : 0.0;
        high[i] = agrees ? std::max(p, most) * BEYOND : 0.0;
    }
}

// Outside of it, with b the end that is nearer,
//     excess = log(|p| / b) / SOFT ,   slope = 1 / (p SOFT) .
double MassRange::excess(const mk_model &model, int number, double &slope) const
{
    slope = 0.0;
    if (number >= mass_count(model) || !(high[number] > 0.0))
        return 0.0;
    // Next to nothing, or of the other sign, is as far off as a hundredth of the least.
    const double size = std::max(sign[number] * model.parameter[number], 0.01 * low[number]);
    if (size >= low[number] && size <= high[number])
        return 0.0;
    slope = sign[number] / (size * SOFT);
    return std::log(size / (size < low[number] ? low[number] : high[number])) / SOFT;
}

bool MassRange::holds(const mk_model &model) const
{
    for (int i = 0; i < mass_count(model); i++) {
        double slope;
        if (excess(model, i, slope) != 0.0)
            return false;
    }
    return true;
}

} // namespace mk

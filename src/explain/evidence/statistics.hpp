// Tail probabilities.
#ifndef MECHKIT_EXPLAIN_EVIDENCE_STATISTICS_HPP
#define MECHKIT_EXPLAIN_EVIDENCE_STATISTICS_HPP

#include <cmath>

namespace mk
{

// Probability that chi-square with k degrees of freedom exceeds x.
inline double chi2_tail(double x, int k)
{
    if (x <= 0.0)
        return 1.0;
    // Series in steps of two degrees (Abramowitz, Stegun 26.4.4, 26.4.5).
    double half = 0.5 * x, sum = 0.0, term = k % 2 ? std::sqrt(x) : 1.0;
    for (int i = k % 2 ? 1 : 0; i < k - 1; i += 2) {
        sum += term;
        term *= x / (double)(i + 2);
    }
    if (k % 2)
        return std::erfc(std::sqrt(half)) +
               std::sqrt(2.0 / 3.14159265358979) * std::exp(-half) * sum;
    return std::exp(-half) * sum;
}

// Probability that a standard normal variable is farther from zero than z.
inline double normal_tails(double z)
{
    return std::erfc(std::fabs(z) / std::sqrt(2.0));
}

} // namespace mk
#endif

// Order statistics.
#ifndef MECHKIT_IDENT_QUANTILES_HPP
#define MECHKIT_IDENT_QUANTILES_HPP

#include <Eigen/Core>
#include <algorithm>

namespace mk
{

// The value below which `share` (0..1) of them are; 0 of none.
inline double quantile(Eigen::VectorXd x, double share)
{
    if (x.size() == 0)
        return 0.0;
    double *at = x.data() + (long)(share * (double)(x.size() - 1));
    std::nth_element(x.data(), at, x.data() + x.size());
    return *at;
}

// Standard deviation of errors about 0 by the median of their sizes: 0.6745 of it where they are
// normal.
inline double deviation(const Eigen::VectorXd &x)
{
    return quantile(x.cwiseAbs(), 0.5) / 0.6745;
}

} // namespace mk
#endif

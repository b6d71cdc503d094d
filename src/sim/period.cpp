#include "sim/period.hpp"

#include <algorithm>
#include <vector>

namespace mk
{

double median_period(const double *t, size_t rows)
{
    constexpr size_t MOST = 10000;
    std::vector<double> steps;
    size_t stride = std::max<size_t>(1, rows / MOST);
    for (size_t k = 0; k + 1 < rows; k += stride)
        steps.push_back(t[k + 1] - t[k]);
    auto middle = steps.begin() + (std::ptrdiff_t)(steps.size() / 2);
    std::nth_element(steps.begin(), middle, steps.end());
    return *middle;
}

} // namespace mk

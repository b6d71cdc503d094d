// The time between the rows of a log that need not be even.
#ifndef MECHKIT_SIM_PERIOD_HPP
#define MECHKIT_SIM_PERIOD_HPP

#include <cstddef>

namespace mk
{

// Median time between rows, of two rows at least, s. Of a long log it looks at ten thousand steps
// spread over all of it. Throws std::bad_alloc.
double median_period(const double *t, size_t rows);

} // namespace mk
#endif

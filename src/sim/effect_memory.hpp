// What effects remember along a log. A cable's pull, an amplifier's lag, a base that sways: their
// states are in no reading, but where the readings have been says what they are.
#ifndef MECHKIT_SIM_EFFECT_MEMORY_HPP
#define MECHKIT_SIM_EFFECT_MEMORY_HPP

#include "sim/window_fit.hpp"

namespace mk
{

// Places of a log, 40 ms apart at most, with angles and speeds by polynomial; a place at each of
// the rows `also` (ascending) too.
std::shared_ptr<const Way> way_of(const mk_record &record, const mk_model &model,
                                  const std::vector<size_t> &also = {});

// Whether what the model's effects remember is found along the way.
bool remembers(const mk_model &model);

// Runs the model along the finder's way: fills its memory, with the derivatives by `parameters`
// (numbers), per unit of each. A memory of as many states and places is what it begins with, and is
// the faster refined the nearer it is.
void remember(mk_start_finder &finder, const std::vector<int> &parameters = {},
              const std::vector<double> &units = {});

// What they remember at a row, after that. `slope`, if any: its derivatives by the same parameters,
// those at the place before the row.
Eigen::VectorXd remembered(const mk_start_finder &finder, size_t row,
                           Eigen::MatrixXd *slope = nullptr);

// State at `row` to start a search from: angles and speeds by polynomial, no reading at `last` or
// later; states of effects from the finder's memory, or by a run of the model up to there. False
// where there are too few readings.
bool first_guess(const mk_start_finder &f, size_t last, size_t row, Eigen::VectorXd &x);

} // namespace mk
#endif

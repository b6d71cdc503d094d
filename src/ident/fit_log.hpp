// A log made ready for fitting: even rows where samples were dropped, commands without holes,
// weights of readings, and the times at which a fit restarts its trajectory.
#ifndef MECHKIT_IDENT_FIT_LOG_HPP
#define MECHKIT_IDENT_FIT_LOG_HPP

#include <vector>

#include "mechkit/log.h"
#include "mechkit/sim.h"
#include "sim/shoot.hpp"

namespace mk
{

struct FitLog {
    int source = 0;        // number of the log that it is a piece of: they share own values
    double start = 0.0;    // of the piece, s from the start of its log: effects may depend on it
    std::vector<double> t; // from the piece's first row on, s
    std::vector<double> u[MK_MAX_INPUTS], q[MK_MAX_JOINTS];
    std::vector<double> weight[MK_MAX_JOINTS]; // 0..1 by reading: how much of an own reading it is
    std::vector<double> doubt;                 // uncertainty of the command at a row, command units
    double count[MK_MAX_JOINTS];               // resolution of the readings, rad; 0: none seen
    double u_step;                             // last digit of the command as logged; 0: none seen
    double v_max[MK_MAX_JOINTS] = {0.0, 0.0};  // largest speed, rad/s
    // Share of a reading's variance that comes again with the same place: all of it for rounding
    // alone, next to none where noise moves readings from count to count.
    double repeating[MK_MAX_JOINTS] = {1.0, 1.0};
    double period; // median time between rows, s
    int joints;

    size_t rows() const { return t.size(); }
    double duration() const { return t.empty() ? 0.0 : t.back(); }
};

// Rows [first, last) of a record.
struct Piece {
    static constexpr size_t FEWEST_ROWS = 20;
    size_t first, last;
};

// What is between holes in the first `rows` rows: a command or angles that are missing for so long
// that they are not bridged, since nobody knows what the rig did meanwhile, or rows that are left
// out. Pieces of a few rows are dropped. `longest`: raised to the longest hole, s. Throws
// std::bad_alloc.
std::vector<Piece> pieces_of(const mk_record &record, size_t rows, double &longest);

// `first`, `last`: rows [first, last) of the record, which is log number `source` of those given.
// Throws std::bad_alloc.
FitLog fit_log(const mk_record &record, const mk_model &model, size_t first, size_t last,
               int source = 0);

// Its first seconds.
FitLog beginning_of(const FitLog &log, double seconds);

// Noise of the readings as their fast scatter shows it, rad; at least what quantisation makes.
double fit_log_noise(const FitLog &log, int joint);

// The same of all logs of a joint, where it is largest.
double scatter_of(const std::vector<const FitLog *> &logs, int joint);
// The same in the log where it is least: fast motion scatters too.
double least_scatter(const std::vector<const FitLog *> &logs, int joint);
// Independent readings of all joints: the sum of their squared weights.
double independent_readings(const std::vector<const FitLog *> &logs);

// How many times that a fit's noise is, at the joint where it is most: far more than 1 where the
// model is off by what does not change from row to row, as a wrong zero.
double beyond_scatter(const std::vector<const FitLog *> &logs, const double *noise);

// How often the logs were already, or will be, at the counts that they see on their way: the median
// of readings in motion. Where that is often, what repeats in their errors does not even out.
// Throws std::bad_alloc.
size_t usual_visits(const std::vector<const FitLog *> &logs);

} // namespace mk
#endif

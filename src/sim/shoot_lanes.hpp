// The shooting kernel's numbers, and the lanes that its intervals travel in. For shoot_kernel.cc
// alone, which is compiled once for each MK_WIDTH and MK_DERIVATIVES.
#ifndef MECHKIT_SIM_SHOOT_LANES_HPP
#define MECHKIT_SIM_SHOOT_LANES_HPP

#include "model/simd.hpp"
#include "model/sparse_dual.hpp"
#include "sim/shoot.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

constexpr int W = MK_WIDTH;
#if MK_WIDTH > 1
using Base = Pack<W>;
inline double get(const Base &x, int lane)
{
    return x[lane];
}
inline void put(Base &x, int lane, double value)
{
    x.set(lane, value);
}
inline bool all_below(const Base &x, double limit)
{
    bool all = true;
    for (int i = 0; i < W; i++)
        all = all && x[i] < limit;
    return all;
}
#else
using Base = double;
inline double get(double x, int)
{
    return x;
}
inline void put(double &x, int, double value)
{
    x = value;
}
inline bool all_below(double x, double limit)
{
    return x < limit;
}
#endif

#if MK_DERIVATIVES
using Scalar = SparseDual<Base>;
constexpr int MOST_COLUMNS = Scalar::MOST;
inline const Base &base_of(const Scalar &x)
{
    return x.v;
}
#else
using Scalar = Base;
constexpr int MOST_COLUMNS = 0;
inline const Base &base_of(const Scalar &x)
{
    return x;
}
#endif

// A state x, or its slope f, of all lanes, and what it depends on: derivative of number i by column
// c in d[i * columns + c].
struct Point {
    Base v[MK_MAX_STATES];
    Base d[MK_MAX_STATES * MOST_COLUMNS + 1];
};
// Derivatives of one number.
struct Row {
    Base d[MOST_COLUMNS + 1];
};

// What close derivatives know of a step (sim/shoot_columns.hpp).
struct Linear {
    Scalar f[MK_MAX_STATES];                   // f in its middle, with A and B
    Base unity[MK_MAX_STATES * MK_MAX_STATES]; // ns x ns
};

// A time that never comes, s.
constexpr double NONE = 1e300;
// How far past a switch a step ends, s, so that the next one starts under the new law.
constexpr double PAST = 1e-8;
// Switches within one planned step that are looked for; further ones are stepped over.
constexpr int MOST_PARTS = 6;

// One stretch on its way.
struct Lane {
    ShootTask *task;          // NULL: the lane is idle
    long command;             // row in force
    long next[MK_MAX_JOINTS]; // first reading not yet taken
    size_t rows;              // readings taken
    double now;
    bool edge; // a new command has just taken over

    // Until the command's next edge, in up to three runs of equal steps.
    double stop[3];
    long least[3]; // steps of a run
    int run, runs;
    // The run.
    double from, to, h;
    long step, steps;
    // The step that is being taken: where it shall end, and how often a law has switched in it.
    double target;
    int switched;
};

} // namespace MK_KERNEL_NS
} // namespace mk
#endif

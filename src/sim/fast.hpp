// The fast path for smooth models: compiled once per instruction set, chosen when the program runs.
#ifndef MECHKIT_SIM_FAST_HPP
#define MECHKIT_SIM_FAST_HPP

#include "mechkit/sim.h"

namespace mk
{

struct FastKernel {
    const char *name;
    int lanes; // trajectories that share a register
    // Runs batch->model_count trajectories; inputs have been checked.
    enum mk_status (*run)(mk_batch *batch, mk_error *err);
    // For tests: y = f(x) lane by lane over n values; function 0 sin, 1 cos, 2 tanh, 3 exp.
    void (*function)(int which, int n, const double *x, double *y);
};

// Kernels that this machine can run, the widest last; NULL beyond.
const FastKernel *fast_kernel(int index);

} // namespace mk
#endif

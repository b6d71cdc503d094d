// The work that all solvers are given: 10 s of the pendubot from hanging under 1.5 sin 6t, output
// each 5 ms.
#ifndef MECHKIT_BENCH_PENDUBOT_HPP
#define MECHKIT_BENCH_PENDUBOT_HPP

#include <cstring>
#include <vector>

#include "mechkit/sim.h"

#define EXPORT extern "C" __attribute__((visibility("default")))

constexpr int PARAMETERS = 7, SAMPLES = 2000;
constexpr double DT = 0.005, PI = 3.14159265358979323846;
constexpr double P[PARAMETERS] = {0.0541, 0.0553, 0.0293, 0.7823, 0.3360, 0.1384, 0.1981};

inline mk_model pendubot(const double *parameters)
{
    mk_model m;
    mk_model_default(MK_PLANT_PENDUBOT, &m);
    memcpy(m.parameter, parameters, sizeof P);
    m.g = 9.81;
    return m;
}

// Samples each `dt` of a trajectory for every model, from the states in x0 on; x gets samples + 1
// states of each. What drives them is still to be set.
inline mk_batch batch_of(const std::vector<mk_model> &models, const std::vector<double> &x0,
                         double dt, int samples, double tolerance, std::vector<double> &x)
{
    x.resize(x0.size() * (size_t)(samples + 1));
    mk_batch b = {};
    b.model = models.data();
    b.model_count = (int)models.size();
    b.dt = dt;
    b.samples = samples;
    b.x0 = x0.data();
    b.rtol = b.atol = tolerance;
    b.x = x.data();
    return b;
}
#endif

// Minimisation without derivatives: evolution of a normal distribution (CMA-ES). For a handful to a
// few dozen unknowns and costs with kinks, cliffs and several valleys.
#ifndef MECHKIT_IDENT_CMA_ES_HPP
#define MECHKIT_IDENT_CMA_ES_HPP

#include <Eigen/Core>
#include <cstdint>
#include <functional>

namespace mk
{

struct CmaOptions {
    double spread = 0.5;     // first standard deviation of every unknown: scale them alike
    long evaluations = 3000; // most calls of the cost
    double tolerance = 1e-6; // stop when the distribution is this narrow
    uint64_t seed = 1;
    int threads = 1; // of the calls of the cost; the answer does not depend on it
    // Called after each generation with the share done and the best cost; false stops.
    std::function<bool(double, double)> progress;
};

struct CmaResult {
    Eigen::VectorXd x;
    double cost;
    long evaluations;
    bool stopped; // by progress
};

using CmaCost = std::function<double(const Eigen::VectorXd &)>;

// N. Hansen, The CMA Evolution Strategy: A Tutorial (2016), algorithm of section 5 with its
// constants, positive weights only. A cost that is not finite counts as worst.
CmaResult cma_es(const CmaCost &cost, const Eigen::VectorXd &start, const CmaOptions &options);

} // namespace mk
#endif

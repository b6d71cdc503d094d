#include "ident/cma_es.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "base/dense.hpp"
#include "base/parallel.hpp"
#include "base/random.h"

namespace mk
{

namespace
{

using Eigen::MatrixXd;
using Eigen::VectorXd;

// The strategy's constants for n unknowns.
struct Constants {
    int population, parents;
    VectorXd weight;
    double mass; // variance-effective number of parents
    double c_sigma, d_sigma, c_c, c_1, c_mu, normal_length;

    explicit Constants(double n)
    {
        population = 4 + (int)(3.0 * std::log(n));
        parents = population / 2;
        weight.resize(parents);
        for (int i = 0; i < parents; i++)
            weight(i) = std::log(0.5 * (population + 1)) - std::log(i + 1.0);
        weight /= weight.sum();
        mass = 1.0 / weight.squaredNorm();
        c_sigma = (mass + 2.0) / (n + mass + 5.0);
        d_sigma = 1.0 + 2.0 * std::max(0.0, std::sqrt((mass - 1.0) / (n + 1.0)) - 1.0) + c_sigma;
        c_c = (4.0 + mass / n) / (n + 4.0 + 2.0 * mass / n);
        c_1 = 2.0 / ((n + 1.3) * (n + 1.3) + mass);
        c_mu =
            std::min(1.0 - c_1, 2.0 * (mass - 2.0 + 1.0 / mass) / ((n + 2.0) * (n + 2.0) + mass));
        normal_length = std::sqrt(n) * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n));
    }
};

class Evolution
{
  public:
    Evolution(const CmaCost &c, const VectorXd &start, const CmaOptions &o)
        : cost(c), options(o), k((double)start.size()), n(start.size()), mean(start),
          path_sigma(VectorXd::Zero(n)), path_c(VectorXd::Zero(n)), shape(MatrixXd::Identity(n, n)),
          axes(MatrixXd::Identity(n, n)), lengths(VectorXd::Ones(n)), sigma(o.spread),
          normal(n, k.population), value((size_t)k.population), order((size_t)k.population)
    {
        random.state = o.seed;
    }

    CmaResult run()
    {
        CmaResult best = {mean, HUGE_VAL, 0, false};
        while (best.evaluations + k.population <= options.evaluations) {
            sample();
            best.evaluations += k.population;
            if (value[order[0]] < best.cost) {
                best.cost = value[order[0]];
                best.x = point(order[0]);
            }
            adapt(++generation);
            double done = (double)best.evaluations / (double)options.evaluations;
            if (options.progress && !options.progress(done, best.cost)) {
                best.stopped = true;
                break;
            }
            if (sigma * lengths.maxCoeff() < options.tolerance)
                break;
        }
        return best;
    }

  private:
    const CmaCost &cost;
    const CmaOptions &options;
    Constants k;
    long n, generation = 0;
    VectorXd mean, path_sigma, path_c;
    MatrixXd shape, axes; // covariance = axes lengths^2 axes'
    VectorXd lengths;
    double sigma;
    MatrixXd normal; // the generation's draws, a column each
    std::vector<double> value;
    std::vector<size_t> order; // best first
    mk_random random;

    VectorXd step(size_t i) const
    {
        return dense::product(axes, VectorXd(lengths.cwiseProduct(normal.col((long)i))));
    }
    VectorXd point(size_t i) const { return previous + previous_sigma * step(i); }
    VectorXd previous;
    double previous_sigma = 0.0;

    void sample()
    {
        previous = mean;
        previous_sigma = sigma;
        for (long i = 0; i < normal.size(); i++)
            normal(i) = mk_random_normal(&random);
        parallel_for(options.threads, value.size(), [&](size_t i) {
            double c = cost(point(i));
            value[i] = std::isfinite(c) ? c : HUGE_VAL;
        });
        std::iota(order.begin(), order.end(), (size_t)0);
        std::stable_sort(order.begin(), order.end(),
                         [&](size_t a, size_t b) { return value[a] < value[b]; });
    }

    void adapt(long g)
    {
        VectorXd drawn = VectorXd::Zero(n); // weighted mean of the parents, in normal coordinates
        MatrixXd spread = MatrixXd::Zero(n, n);
        for (int i = 0; i < k.parents; i++) {
            VectorXd y = step(order[(size_t)i]);
            drawn += k.weight(i) * normal.col((long)order[(size_t)i]);
            spread += k.weight(i) * y * y.transpose();
        }
        VectorXd moved = dense::product(axes, VectorXd(lengths.cwiseProduct(drawn)));
        mean += sigma * moved;
        path_sigma =
            (1.0 - k.c_sigma) * path_sigma +
            std::sqrt(k.c_sigma * (2.0 - k.c_sigma) * k.mass) * dense::product(axes, drawn);
        double settled = std::sqrt(1.0 - std::pow(1.0 - k.c_sigma, 2.0 * (double)g));
        bool slow = path_sigma.norm() / settled < (1.4 + 2.0 / ((double)n + 1.0)) * k.normal_length;
        path_c *= 1.0 - k.c_c;
        if (slow)
            path_c += std::sqrt(k.c_c * (2.0 - k.c_c) * k.mass) * moved;
        double lost = slow ? 0.0 : k.c_1 * k.c_c * (2.0 - k.c_c);
        shape *= 1.0 - k.c_1 - k.c_mu + lost;
        shape += k.c_1 * path_c * path_c.transpose() + k.c_mu * spread;
        sigma *= std::exp(k.c_sigma / k.d_sigma * (path_sigma.norm() / k.normal_length - 1.0));
        VectorXd values;
        dense::eigen(shape, values, axes);
        lengths = values.cwiseMax(1e-20).cwiseSqrt();
    }
};

} // namespace

CmaResult cma_es(const CmaCost &cost, const VectorXd &start, const CmaOptions &options)
{
    return Evolution(cost, start, options).run();
}

} // namespace mk

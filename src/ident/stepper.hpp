// Steps of a model's parameters towards the minimum of a quadratic.
#ifndef MECHKIT_IDENT_STEPPER_HPP
#define MECHKIT_IDENT_STEPPER_HPP

#include "ident/fit.hpp"

namespace mk
{

// Steps are taken in coordinates in which the model is as linear as can be: amplitude and phase as
// sine and cosine parts, stiffness and rest position as stiffness and offset torque. Coordinates
// that would leave their range stop at its end.
class Stepper
{
  public:
    // Both must outlive it; `free`: numbers as in mechkit/ident.h.
    Stepper(const mk_model &model, const std::vector<int> &free);
    // (H + damping diag H) d = g within the ranges.
    Eigen::VectorXd solve(const QuadraticModel &p, double damping) const;
    // The same step as the kernel's scaled parameters see it, to first order.
    Eigen::VectorXd parameters(const Eigen::VectorXd &step) const { return turn * step; }
    void apply(mk_model &m, const Eigen::VectorXd &step) const;

  private:
    struct Pair {
        long size, other; // places in `free`
        bool polar;
        double reference;
    };
    const mk_model &model;
    const std::vector<int> &free;
    Eigen::VectorXd scale, low, high; // of the step
    Eigen::MatrixXd turn;             // d(scaled parameters) / d(step)
    std::vector<Pair> pairs;

    long place_of(int number) const;
    void keep_zeros_near();
    void find_pairs();
    void add(int e, long size, long other, bool polar);
};

} // namespace mk
#endif

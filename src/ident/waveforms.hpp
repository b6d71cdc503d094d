// What excitation is made of: a Fourier series for a joint that is led, a multisine for a command.
#ifndef MECHKIT_IDENT_WAVEFORMS_HPP
#define MECHKIT_IDENT_WAVEFORMS_HPP

#include <Eigen/Core>
#include <string>
#include <vector>

namespace mk
{

// The series (3.9)-(3.11) of the report: dq/dt = sum a_l cos(l w t) + b_l sin(l w t).
class Series
{
  public:
    // Starts at q_start with no speed and no acceleration: (3.15) for any number of harmonics,
    // sum a_l = 0, sum l b_l = 0, q0 = q_start + sum b_l / (l w). For two harmonics a2 = -a1,
    // b2 = -b1/2, q0 = q_start + 3 b1 / (4 w). Unknowns: amplitudes in rad of the harmonics from
    // the second on, sines first, so 2 (harmonics - 1) of them.
    Series(double omega, const Eigen::VectorXd &amplitudes, double q_start);

    void at(double t, double &q, double &v, double &a) const;

    double omega, offset;
    std::vector<double> a, b; // by harmonic, rad/s
};

// u = limit tanh(sum a_l sin(l w t) + b_l cos(l w t)): smooth, and never beyond its limit.
class Multisine
{
  public:
    // Coefficients a_1, b_1, a_2, b_2 ...
    Multisine(double limit, double omega, const Eigen::VectorXd &coefficients);

    double at(double t) const;
    // As a signal (mechkit/signal.h).
    std::string text() const;

  private:
    double limit, omega;
    Eigen::VectorXd coefficients;
};

} // namespace mk
#endif

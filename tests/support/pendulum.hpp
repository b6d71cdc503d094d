// A pendulum in which a test hides an effect: a torque balance in steps of 20 us, friction and
// contact resolved, its readings quantised to counts. It shares no code with the program under
// test.
#ifndef MECHKIT_TESTS_PENDULUM_HPP
#define MECHKIT_TESTS_PENDULUM_HPP

#include "mechkit/explain.h"

namespace made_up
{

// Base parameters as in docs/theory.md: kg m^2, N m, N m s, N m.
constexpr double J = 0.0611, MGL = 6.9, C = 0.0123, F = 0.352;
// Readings: rows a second, steps of the simulation (s), a count of the encoder (rad).
constexpr double RATE = 250.0, STEP = 2e-5, COUNT = 6.283185307179586 / 4000.0;

// What is hidden, in the pendulum's own terms.
struct Hidden {
    double drag = 0.0;         // v|v|
    double cubic = 0.0;        // v^3
    double dead = 0.0;         // of the amplifier
    double delay = 0.0;        // s
    double tilt = 0.0;         // rad
    double missed_count = 0.0; // rad, at two instants
    bool bumper = false;       // a stop at 0.6 rad
};

// What happens in one step of the simulation: q in rad, v in rad/s, the command that acts.
void step(const Hidden &h, double &q, double &v, double command);
// The command, N m, at t: 0 three sines, 1 a chirp.
double command_at(double t, int kind);
// The caller owns the log.
mk_log *record(const Hidden &h, int kind, double seconds);

// The pendulum without what is hidden, its values right or 8 to 10 % off.
mk_model pendulum(bool exact);
// Frees the logs; `hold` may be null.
mk_explanation explained(const mk_model &model, mk_log *train, mk_log *hold, double most_s = 0.0,
                         bool keep_all = false);
mk_explanation explained(const Hidden &h, bool exact = false, double most_s = 0.0);
// Whether a cause has this name, or what the data cannot tell from it.
bool named(const mk_explanation &e, const char *name);

} // namespace made_up
#endif

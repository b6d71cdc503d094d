// What integrates a model between two edges of its command: a table of solvers.
#ifndef MECHKIT_SIM_INTEGRATOR_HPP
#define MECHKIT_SIM_INTEGRATOR_HPP

#include "mechkit/sim.h"
#include "model/rhs.hpp"

namespace mk
{

// What is integrated: the model's states and, last, the work that the motors have done.
struct System {
    mk_model model;
    Compiled<double> compiled;
    int states; // of the model; y has one more
    int events;
    double rtol, atol;
    double u[MK_MAX_INPUTS]; // command in force, constant while a solver runs

    int size() const { return states + 1; }
    void rhs(double t, const double *y, double *dy) const
    {
        mk::rhs(compiled, t, y, u, dy, &dy[states]);
    }
};

// A solver behind one interface. None of the calls but create allocates.
class Integrator
{
  public:
    virtual ~Integrator() = default;
    // The state or the command has jumped: history is void.
    virtual enum mk_status restart(double t, const double *y) = 0;
    // From the time of the last call to t_end exactly; y is the state there. Stops at events on the
    // way, counts them, and goes on.
    virtual enum mk_status advance(double t_end, double *y, mk_error *err) = 0;
    virtual void stats(mk_sim_stats *out) const = 0;
};

struct SolverRow {
    enum mk_solver kind;
    const char *name;
    bool any_model; // else models without states and events of effects
    // nullptr and *err on failure. The system must outlive the integrator.
    Integrator *(*create)(const System &system, mk_error *err);
};

// Rows of the table, each in the file that knows its library.
Integrator *create_cvode_adams(const System &system, mk_error *err);
Integrator *create_cvode_bdf(const System &system, mk_error *err);
Integrator *create_arkode_erk(const System &system, mk_error *err);
Integrator *create_dop853(const System &system, mk_error *err);

const SolverRow *solver_row(enum mk_solver kind);

} // namespace mk
#endif

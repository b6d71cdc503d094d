// The explicit method of order 8 behind the solver interface, for smooth models.
#include "sim/dop853.hpp"

#include <cmath>
#include <new>

#include "sim/integrator.hpp"

namespace mk
{
namespace
{

struct Slope {
    const System &system;
    void operator()(double t, const double *y, double *dy) const { system.rhs(t, y, dy); }
};

// Y states of the model and the work.
template <int Y>
class Dop853Integrator : public Integrator
{
    Slope slope_;
    Dop853<double, Y, Slope> solver_;
    uint64_t restarts_ = 0;

  public:
    explicit Dop853Integrator(const System &system)
        : slope_{system}, solver_(slope_, system.rtol, system.atol)
    {
    }
    enum mk_status restart(double t, const double *y) override
    {
        solver_.start(t, y);
        restarts_++;
        return MK_OK;
    }
    enum mk_status advance(double t_end, double *y, mk_error *err) override
    {
        while (solver_.time() < t_end) {
            solver_.advance();
            if (!solver_.step(t_end))
                return mk_error_set(err, MK_ERR_NUMERIC, "DOP853 gave up at t = %.6g s",
                                    solver_.time());
        }
        for (int i = 0; i < Y; i++)
            y[i] = solver_.state()[i];
        return MK_OK;
    }
    void stats(mk_sim_stats *out) const override
    {
        *out = {solver_.steps, solver_.evaluations, 0, restarts_};
    }
};

} // namespace

Integrator *create_dop853(const System &system, mk_error *err)
{
    Integrator *made = nullptr;
    if (system.size() == 3)
        made = new (std::nothrow) Dop853Integrator<3>(system);
    else if (system.size() == 5)
        made = new (std::nothrow) Dop853Integrator<5>(system);
    if (!made)
        mk_error_set(err, MK_ERR_NOMEM, "cannot create DOP853");
    return made;
}

} // namespace mk

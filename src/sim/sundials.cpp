// CVODE and ARKODE behind the solver interface (sim/integrator.hpp). The only file that knows
// SUNDIALS; builds with 6.x and 7.x (A. Hindmarsh and others, ACM TOMS 31, 2005).
//
// Both integrate dy/dt = f(t, y) with the local error kept at
//     sqrt(1/n sum_i (e_i / (rtol |y_i| + atol_i))^2) <= 1 .
// y are the model's states and, last, the work of the motors. Between two edges of the command u is
// constant and f is smooth but for switching functions g(t, y), whose roots the libraries find: the
// integration stops there and starts again.
//
// ARKODE: Verner's explicit method of order 6 with an embedded one of order 5, eight stages. With h
// the step and k_i the slopes at its stages,
//     k_i = f(t + c_i h, y + h sum_(j<i) a_ij k_j) ,   y(t + h) = y + h sum_i b_i k_i ,
//     e = h sum_i (b_i - b^_i) k_i ,
// b^ the weights of order 5. A one-step method keeps its step over an edge.
//
// CVODE: implicit multistep formulas. With gamma = h beta_0, and a what is known from earlier
// steps, each step solves
//     y - gamma f(t, y) - a = 0 .
// Adams-Moulton formulas (orders 1 to 12) for long smooth runs: by fixed-point iteration, which
// converges where gamma times the norm of df/dy is below 1. BDF (orders 1 to 5) for stiff contact:
// by Newton's method with 1 - gamma J, J = df/dy exact, which has no such bound. Multistep methods
// lose their history at every edge and begin again at order 1.
//
// Every create_...() returns an integrator that the caller deletes, or nullptr and MK_ERR_NOMEM; it
// keeps a reference to the System, whose command and model may change between two runs.
#include <arkode/arkode_erkstep.h>
#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_context.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#include <cmath>
#include <cstring>
#include <new>

#include "sim/integrator.hpp"

// ARKODE's functions by the names that they have since SUNDIALS 7.1, whichever version is there.
// Until 7.0 each stepper has its own (ERKStepEvolve); from 7.1 on one name serves all of them
// (ARKodeEvolve) and the old one is deprecated. The count of right-hand sides followed in 7.2.
#if SUNDIALS_VERSION_MAJOR < 7 || (SUNDIALS_VERSION_MAJOR == 7 && SUNDIALS_VERSION_MINOR < 1)
#define ARKodeEvolve ERKStepEvolve
#define ARKodeFree ERKStepFree
#define ARKodeGetCurrentStep ERKStepGetCurrentStep
#define ARKodeGetNumSteps ERKStepGetNumSteps
#define ARKodeRootInit ERKStepRootInit
#define ARKodeSetInitStep ERKStepSetInitStep
#define ARKodeSetMaxErrTestFails ERKStepSetMaxErrTestFails
#define ARKodeSetMaxHnilWarns ERKStepSetMaxHnilWarns
#define ARKodeSetMaxNumSteps ERKStepSetMaxNumSteps
#define ARKodeSetStopTime ERKStepSetStopTime
#define ARKodeSVtolerances ERKStepSVtolerances
#define ARKodeSetUserData ERKStepSetUserData
#endif

namespace mk
{
namespace
{

// Steps in one call; beyond that the problem is not what we think it is.
constexpr long MAX_STEPS = 500000;

// A link that comes to rest lets the step grow far beyond what friction at rest bears: the way back
// takes more attempts than the usual seven.
constexpr int MAX_ERROR_TESTS = 50;

// SUNDIALS 7 reports errors through handlers of the context, which print unless they are cleared; 6
// through the solver's own file.
bool create_context(SUNContext *ctx)
{
#if SUNDIALS_VERSION_MAJOR >= 7
    if (SUNContext_Create(SUN_COMM_NULL, ctx) != 0)
        return false;
    SUNContext_ClearErrHandlers(*ctx); // the library reports; it does not print
    return true;
#else
    return SUNContext_Create(nullptr, ctx) == 0;
#endif
}

// f(t, y), the work's rate last. 0: fine; above 0: recoverable, the library takes a shorter step
// and tries again; below 0 it would give up. A number that is not finite is recoverable: the step
// was too long.
int on_rhs(sunrealtype t, N_Vector y, N_Vector dy, void *user)
{
    const System *system = static_cast<const System *>(user);
    const double *yd = N_VGetArrayPointer(y);
    double *dyd = N_VGetArrayPointer(dy);
    system->rhs(t, yd, dyd);
    for (int i = 0; i < system->size(); i++)
        if (!std::isfinite(dyd[i]))
            return 1; // recoverable: try a smaller step
    return 0;
}

// g, under the command in force.
int on_events(sunrealtype t, N_Vector y, sunrealtype *g, void *user)
{
    const System *system = static_cast<const System *>(user);
    mk_model_events(&system->model, t, N_VGetArrayPointer(y), system->u, g);
    return 0;
}

// df/dy, exact (model/dual.hpp). The row and column of the work are 0: nothing depends on the work,
// and Newton's method, which only needs J near enough to converge, does without how the work
// depends on the rest.
int on_jacobian(sunrealtype t, N_Vector y, N_Vector, SUNMatrix jac, void *user, N_Vector, N_Vector,
                N_Vector)
{
    const System *system = static_cast<const System *>(user);
    double j[MK_MAX_STATES * MK_MAX_STATES];
    mk_model_jacobian(&system->model, t, N_VGetArrayPointer(y), system->u, j, nullptr, nullptr);
    for (int row = 0; row < system->size(); row++)
        for (int col = 0; col < system->size(); col++) {
            // Nothing depends on the work, and Newton does not need how the work depends on the
            // rest.
            bool work = row == system->states || col == system->states;
            SM_ELEMENT_D(jac, row, col) = work ? 0.0 : j[row * system->states + col];
        }
    return 0;
}

// MK_ERR_NUMERIC with the library's own code in err->os_code.
enum mk_status gave_up(mk_error *err, const char *what, int flag, double t)
{
    enum mk_status st = mk_error_set(
        err, MK_ERR_NUMERIC,
        "%s gave up at t = %.6g s (code %d): the model changes too fast there, as one with a "
        "stiff effect or a small inertia does",
        what, t, flag);
    if (err)
        err->os_code = flag;
    return st;
}

// Vectors, context and counters that both families need.
class SundialsBase : public Integrator
{
  protected:
    const System &system_;
    SUNContext ctx_ = nullptr;
    N_Vector y_ = nullptr, tolerance_ = nullptr;
    double t_ = 0.0;
    // Counted over restarts, at which the solver's own counters begin anew.
    uint64_t steps_ = 0, evaluations_ = 0, events_ = 0, restarts_ = 0;

    explicit SundialsBase(const System &system) : system_(system) {}
    ~SundialsBase() override
    {
        if (y_)
            N_VDestroy(y_);
        if (tolerance_)
            N_VDestroy(tolerance_);
        if (ctx_)
            SUNContext_Free(&ctx_);
    }
    // y_ and tolerance_ have size() = states + 1 values. False where there is no memory; what is
    // made by then is freed by the destructor.
    bool create_vectors()
    {
        if (!create_context(&ctx_))
            return false;
        y_ = N_VNew_Serial(system_.size(), ctx_);
        tolerance_ = N_VNew_Serial(system_.size(), ctx_);
        if (!y_ || !tolerance_)
            return false;
        N_VConst(0.0, y_);
        // atol_i: that of the model's states, and 1000 times as much of the work.
        N_VConst(system_.atol, tolerance_);
        // Bookkeeping must not drive the step size: work is as good as the states it follows.
        N_VGetArrayPointer(tolerance_)[system_.states] = 1e3 * system_.atol;
        return true;
    }
    // Between the caller's y and the library's vector; unload() is the way back.
    void load(double t, const double *y)
    {
        t_ = t;
        memcpy(N_VGetArrayPointer(y_), y, sizeof(double) * static_cast<size_t>(system_.size()));
        restarts_++;
    }
    // Adds what the solver has counted since its last start, before that is lost.
    void count(long steps, long evaluations)
    {
        steps_ += static_cast<uint64_t>(steps);
        evaluations_ += static_cast<uint64_t>(evaluations);
    }
    mk_sim_stats totals(long steps, long evaluations) const
    {
        return {steps_ + static_cast<uint64_t>(steps),
                evaluations_ + static_cast<uint64_t>(evaluations), events_, restarts_};
    }
    void unload(double *y) const
    {
        memcpy(y, N_VGetArrayPointer(y_), sizeof(double) * static_cast<size_t>(system_.size()));
    }
};

class Cvode : public SundialsBase
{
    void *mem_ = nullptr;
    SUNMatrix matrix_ = nullptr;
    SUNLinearSolver linear_ = nullptr;
    SUNNonlinearSolver nonlinear_ = nullptr;

  public:
    explicit Cvode(const System &system) : SundialsBase(system) {}
    ~Cvode() override
    {
        if (mem_)
            CVodeFree(&mem_);
        if (nonlinear_)
            SUNNonlinSolFree(nonlinear_);
        if (linear_)
            SUNLinSolFree(linear_);
        if (matrix_)
            SUNMatDestroy(matrix_);
    }
    // `method`: CV_ADAMS or CV_BDF.
    bool create(int method)
    {
        if (!create_vectors() || !(mem_ = CVodeCreate(method, ctx_)))
            return false;
#if SUNDIALS_VERSION_MAJOR < 7
        CVodeSetErrFile(mem_, nullptr);
#endif
        // Right-hand side, tolerances, limit of steps; the warning for steps that do not change t
        // is off.
        if (CVodeInit(mem_, on_rhs, 0.0, y_) != 0 ||
            CVodeSVtolerances(mem_, system_.rtol, tolerance_) != 0 ||
            CVodeSetUserData(mem_, const_cast<System *>(&system_)) != 0 ||
            CVodeSetMaxNumSteps(mem_, MAX_STEPS) != 0 || CVodeSetMaxHnilWarns(mem_, -1) != 0)
            return false;
        if (system_.events && CVodeRootInit(mem_, system_.events, on_events) != 0)
            return false;
        return method == CV_BDF ? attach_newton() : attach_fixed_point();
    }
    enum mk_status restart(double t, const double *y) override
    {
        load(t, y);
        return reinit();
    }
    // To t_end exactly: the stop time keeps steps from reaching over the edge, where u changes.
    enum mk_status advance(double t_end, double *y, mk_error *err) override
    {
        CVodeSetStopTime(mem_, t_end);
        while (t_ < t_end) {
            // CV_NORMAL: to t_end, by interpolation unless it is the stop time; back earlier at a
            // root.
            int flag = CVode(mem_, t_end, y_, &t_, CV_NORMAL);
            if (flag < 0)
                return gave_up(err, "CVODE", flag, t_);
            if (flag != CV_ROOT_RETURN)
                continue;
            events_++;
            if (reinit() != MK_OK)
                return gave_up(err, "CVODE", flag, t_);
            CVodeSetStopTime(mem_, t_end);
        }
        unload(y);
        return MK_OK;
    }
    void stats(mk_sim_stats *out) const override
    {
        long steps = 0, evaluations = 0;
        CVodeGetNumSteps(mem_, &steps);
        CVodeGetNumRhsEvals(mem_, &evaluations);
        *out = totals(steps, evaluations);
    }

  private:
    // A new start at t: order 1, step found anew. Counters are saved before they begin at 0.
    enum mk_status reinit()
    {
        long steps = 0, evaluations = 0;
        CVodeGetNumSteps(mem_, &steps);
        CVodeGetNumRhsEvals(mem_, &evaluations);
        count(steps, evaluations);
        return CVodeReInit(mem_, t_, y_) == 0 ? MK_OK : MK_ERR_NUMERIC;
    }
    // Solution of each implicit step of BDF: Newton's method with dense LU of 1 - gamma J.
    bool attach_newton()
    {
        matrix_ = SUNDenseMatrix(system_.size(), system_.size(), ctx_);
        linear_ = matrix_ ? SUNLinSol_Dense(y_, matrix_, ctx_) : nullptr;
        return linear_ && CVodeSetLinearSolver(mem_, linear_, matrix_) == 0 &&
               CVodeSetJacFn(mem_, on_jacobian) == 0;
    }
    // Of Adams' formulas: y = gamma f(t, y) + a by fixed-point iteration, without acceleration (0).
    bool attach_fixed_point()
    {
        nonlinear_ = SUNNonlinSol_FixedPoint(y_, 0, ctx_);
        return nonlinear_ && CVodeSetNonlinearSolver(mem_, nonlinear_) == 0;
    }
};

// Evaluations of f so far by an ERKStep memory, in `evaluations`. 0: success.
int erk_evaluations(void *memory, long *evaluations)
{
#if SUNDIALS_VERSION_MAJOR < 7 || (SUNDIALS_VERSION_MAJOR == 7 && SUNDIALS_VERSION_MINOR < 2)
    return ERKStepGetNumRhsEvals(memory, evaluations);
#else
    return ARKodeGetNumRhsEvals(memory, 0, evaluations);
#endif
}

// ARKODE's explicit one-step method. last_step_ is the step that it would take next, s; 0 before
// the first run.
class Erk : public SundialsBase
{
    void *mem_ = nullptr;
    double last_step_ = 0.0;

  public:
    explicit Erk(const System &system) : SundialsBase(system) {}
    ~Erk() override
    {
        if (mem_)
            ARKodeFree(&mem_);
    }
    bool create()
    {
        if (!create_vectors() || !(mem_ = ERKStepCreate(on_rhs, 0.0, y_, ctx_)))
            return false;
#if SUNDIALS_VERSION_MAJOR < 7
        ERKStepSetErrFile(mem_, nullptr);
#endif
        return ARKodeSVtolerances(mem_, system_.rtol, tolerance_) == 0 &&
               ARKodeSetUserData(mem_, const_cast<System *>(&system_)) == 0 &&
               ERKStepSetTableNum(mem_, ARKODE_VERNER_8_5_6) == 0 &&
               ARKodeSetMaxNumSteps(mem_, MAX_STEPS) == 0 && ARKodeSetMaxHnilWarns(mem_, -1) == 0 &&
               ARKodeSetMaxErrTestFails(mem_, MAX_ERROR_TESTS) == 0 &&
               (!system_.events || ARKodeRootInit(mem_, system_.events, on_events) == 0);
    }
    enum mk_status restart(double t, const double *y) override
    {
        load(t, y);
        return reinit(0.0);
    }
    // As Cvode::advance(). Behind a root of g the law is another one, so that slopes of the step
    // before it mean nothing: the method starts anew at the root.
    enum mk_status advance(double t_end, double *y, mk_error *err) override
    {
        ARKodeSetStopTime(mem_, t_end);
        while (t_ < t_end) {
            // To t_end or to the first root of g on the way.
            int flag = ARKodeEvolve(mem_, t_end, y_, &t_, ARK_NORMAL);
            if (flag < 0)
                return gave_up(err, "ARKODE", flag, t_);
            ARKodeGetCurrentStep(mem_, &last_step_);
            if (flag != ARK_ROOT_RETURN)
                continue;
            events_++;
            if (reinit(t_end - t_) != MK_OK)
                return gave_up(err, "ARKODE", flag, t_);
            ARKodeSetStopTime(mem_, t_end);
        }
        unload(y);
        return MK_OK;
    }
    void stats(mk_sim_stats *out) const override
    {
        long steps = 0, evaluations = 0;
        ARKodeGetNumSteps(mem_, &steps);
        erk_evaluations(mem_, &evaluations);
        *out = totals(steps, evaluations);
    }

  private:
    // A one-step method needs no new first step after an edge: the step it was taking will do (an
    // error test corrects it). After an event it is not longer than what is left to t_end.
    enum mk_status reinit(double longest)
    {
        long steps = 0, evaluations = 0;
        ARKodeGetNumSteps(mem_, &steps);
        erk_evaluations(mem_, &evaluations);
        count(steps, evaluations);
        if (ERKStepReInit(mem_, on_rhs, t_, y_) != 0)
            return MK_ERR_NUMERIC;
        double h = longest > 0.0 ? std::fmin(last_step_, longest) : last_step_;
        return h > 0.0 && ARKodeSetInitStep(mem_, h) != 0 ? MK_ERR_NUMERIC : MK_OK;
    }
};

Integrator *finish(Integrator *made, bool good, const char *what, mk_error *err)
{
    if (made && good)
        return made;
    delete made;
    mk_error_set(err, MK_ERR_NOMEM, "cannot create %s", what);
    return nullptr;
}

} // namespace

Integrator *create_cvode_adams(const System &system, mk_error *err)
{
    Cvode *made = new (std::nothrow) Cvode(system);
    return finish(made, made && made->create(CV_ADAMS), "CVODE", err);
}

Integrator *create_cvode_bdf(const System &system, mk_error *err)
{
    Cvode *made = new (std::nothrow) Cvode(system);
    return finish(made, made && made->create(CV_BDF), "CVODE", err);
}

Integrator *create_arkode_erk(const System &system, mk_error *err)
{
    Erk *made = new (std::nothrow) Erk(system);
    return finish(made, made && made->create(), "ARKODE", err);
}

} // namespace mk

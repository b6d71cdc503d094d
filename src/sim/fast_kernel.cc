// The fast kernel of one instruction set (MK_ISA). Everything is in a namespace of its own and
// calls no inline functions of the standard library, so that code for wide registers cannot leak
// into the rest of the program through the linker.
#include "model/rhs.hpp"
#include "sim/collocation.hpp"
#include "sim/dop853.hpp"
#include "sim/fast.hpp"

namespace mk
{
inline namespace MK_KERNEL_NS
{

#if defined(__AVX512F__)
constexpr int LANES = 8;
#elif defined(__AVX__)
constexpr int LANES = 4;
#else
constexpr int LANES = 2;
#endif

inline void put(double &x, int, double value)
{
    x = value;
}
template <int W>
inline void put(Pack<W> &x, int lane, double value)
{
    x.set(lane, value);
}
inline double get(double x, int)
{
    return x;
}
template <int W>
inline double get(const Pack<W> &x, int lane)
{
    return x[lane];
}

// Trajectories first .. first + used - 1 of a batch, in `lanes` lanes; spare lanes repeat the last
// one.
template <class S>
struct Group {
    const mk_batch *batch;
    int first, used, lanes, ns;

    int index(int lane) const { return first + (lane < used ? lane : used - 1); }
    Compiled<S> compiled() const
    {
        Compiled<S> c = compile<S>(batch->model[first]);
        for (int lane = 0; lane < lanes; lane++) {
            const mk_model &m = batch->model[index(lane)];
            for (int i = 0; i < c.parameter_count; i++)
                put(c.p[i], lane, m.parameter[i]);
            for (int e = 0; e < c.effect_count; e++)
                for (int i = 0; i < MK_MAX_EFFECT_PARAMETERS; i++)
                    put(c.effect[e].p[i], lane, m.effect[e].value[i]);
        }
        return c;
    }
    void load(S *y) const
    {
        for (int lane = 0; lane < lanes; lane++)
            for (int i = 0; i < ns; i++)
                put(y[i], lane, batch->x0[index(lane) * ns + i]);
    }
    void store(int k, const S *y) const
    {
        for (int lane = 0; lane < used; lane++) {
            double *row = batch->x + (long)((first + lane) * (batch->samples + 1) + k) * ns;
            for (int i = 0; i < ns; i++)
                row[i] = get(y[i], lane);
        }
    }
    void command(int k, S *u) const
    {
        for (int lane = 0; lane < lanes; lane++)
            for (int i = 0; i < MK_MAX_INPUTS; i++)
                put(u[i], lane,
                    batch->u[(long)(index(lane) * batch->samples + k) * MK_MAX_INPUTS + i]);
    }
};

// Its operations overlap with those of the right-hand side, which a call would keep apart.
inline double sine_of(double x)
{
    if (__builtin_expect(!(__builtin_fabs(x) < poly::LARGE), 0))
        return sin(x);
    double s, c;
    poly::sincos(x, s, c);
    return s;
}

// BARE: the models have no effects.
template <class Law, class S, bool BARE>
struct Rhs {
    const Compiled<S> &c;
    const mk_sine *drive; // of the group's first trajectory; NULL: u is held
    S u[MK_MAX_INPUTS];
    void operator()(double t, const S *y, S *dy)
    {
        if (drive)
            u[0] = S(drive->amplitude * sine_of(drive->omega * t + drive->phase));
        if constexpr (BARE)
            bare_rhs_of<Law>(c, y, u, dy);
        else
            rhs_of<Law>(c, S(t), y, u, dy);
    }
};

inline enum mk_status stuck(mk_error *err, double t)
{
    return mk_error_set(err, MK_ERR_NUMERIC, "the fast integrator cannot go on at t = %g s", t);
}

template <class Law, class S, bool BARE>
enum mk_status run_group(const Group<S> &g, const Compiled<S> &c, mk_batch *batch, mk_error *err)
{
    constexpr int N = 2 * Law::joints;
    Rhs<Law, S, BARE> f = {c, batch->drive, {S(0.0), S(0.0)}};
    Dop853<S, N, Rhs<Law, S, BARE>> solver(f, batch->rtol, batch->atol);
    S y[N] = {};
    g.load(y);
    g.store(0, y);
    if (!batch->drive)
        g.command(0, f.u);
    solver.start(batch->t0, y);
    double t_end = batch->t0 + batch->dt * batch->samples;
    for (int k = 0; k < batch->samples;) {
        // Held commands: stop at every edge. Smooth drive: step freely and interpolate.
        double t_stop = batch->drive ? t_end : batch->t0 + batch->dt * (k + 1);
        solver.advance();
        if (!solver.step(t_stop))
            return stuck(err, solver.time());
        if (batch->drive) {
            for (; k < batch->samples; k++) {
                double t = batch->t0 + batch->dt * (k + 1);
                if (t > solver.time() && k + 1 < batch->samples)
                    break;
                if (k + 1 == batch->samples && solver.time() < t_end)
                    break;
                if (t >= solver.time()) {
                    g.store(k + 1, solver.state());
                } else {
                    solver.interpolate(t, y);
                    g.store(k + 1, y);
                }
            }
        } else if (solver.time() >= t_stop) {
            g.store(++k, solver.state());
            if (k < batch->samples) {
                g.command(k, f.u);
                solver.advance();
                solver.edge();
            }
        }
    }
    batch->steps += solver.steps * (uint64_t)g.used;
    return MK_OK;
}

// Accelerations of one trajectory without effects at W times of a smooth drive.
template <class Law, int W>
struct Accelerations {
    const Compiled<Pack<W>> &c;
    const mk_sine *drive;

    Pack<W> command(const Pack<W> &t) const
    {
        return drive->amplitude * sin(drive->omega * t + drive->phase);
    }
    void operator()(const Pack<W> &command, const Pack<W> *x, Pack<W> *a) const
    {
        constexpr int J = Law::joints;
        const Pack<W> u[MK_MAX_INPUTS] = {command, Pack<W>(0.0)};
        Pack<W> slope[2 * J];
        bare_rhs_of<Law>(c, x, u, slope);
        for (int j = 0; j < J; j++)
            a[j] = slope[J + j];
    }
};

// One trajectory under a smooth drive, in steps as long as they can be.
template <class Law, int W>
enum mk_status run_alone(const Compiled<Pack<W>> &c, mk_batch *batch, int index, mk_error *err)
{
    constexpr int J = Law::joints, NS = 2 * J;
    const Accelerations<Law, W> f = {c, batch->drive};
    Collocation<J, W, const Accelerations<Law, W>> solver(f, batch->rtol, batch->atol);
    double *out = batch->x + (long)index * (batch->samples + 1) * NS;
    memcpy(out, batch->x0 + (long)index * NS, sizeof(double) * NS);
    solver.start(batch->t0, out);
    const double t_end = batch->t0 + batch->dt * batch->samples;
    for (int k = 1; k <= batch->samples;) {
        if (!solver.step(t_end))
            return stuck(err, solver.time());
        const bool last = solver.time() >= t_end;
        for (;;) { // W outputs at a time
            Pack<W> t, x[NS];
            int count = 0;
            for (int i = 0; i < W; i++) {
                const double at = batch->t0 + batch->dt * (k + i);
                t.set(i, at);
                count += k + i <= batch->samples && (at <= solver.time() || last);
            }
            if (count == 0)
                break;
            solver.interpolate(t, x);
            for (int i = 0; i < count; i++, k++)
                for (int n = 0; n < NS; n++)
                    out[(long)k * NS + n] = x[n][i];
        }
    }
    batch->steps += solver.steps;
    return MK_OK;
}

template <class S>
enum mk_status run_lanes(mk_batch *batch, int first, int used, int lanes, mk_error *err)
{
    Group<S> g = {batch, first, used, lanes, mk_model_state_count(&batch->model[0])};
    return with_plant(batch->model[0].plant, [&](auto law) {
        using Law = decltype(law);
        const Compiled<S> c = g.compiled();
        return c.effect_count == 0 ? run_group<Law, S, true>(g, c, batch, err)
                                   : run_group<Law, S, false>(g, c, batch, err);
    });
}

// A trajectory alone under a smooth drive fills the registers with the points of its steps, where
// they are wide enough for that to pay. Effects make corners, at which high order is of no use.
template <int W>
enum mk_status run_one(mk_batch *batch, int index, mk_error *err)
{
    const mk_model &model = batch->model[index];
    if constexpr (W >= 4)
        if (batch->drive && model.effect_count == 0) {
            const Group<Pack<W>> g = {batch, index, 1, W, mk_model_state_count(&model)};
            return with_plant(model.plant, [&](auto law) {
                return run_alone<decltype(law), W>(g.compiled(), batch, index, err);
            });
        }
    return run_lanes<double>(batch, index, 1, 1, err);
}

static enum mk_status run(mk_batch *batch, mk_error *err)
{
    int done = 0;
    while (done < batch->model_count) {
        int left = batch->model_count - done, used = left < LANES ? left : LANES;
        enum mk_status st = used == 1 ? run_one<LANES>(batch, done, err)
                                      : run_lanes<Pack<LANES>>(batch, done, used, LANES, err);
        if (st != MK_OK)
            return st;
        done += used;
    }
    return MK_OK;
}

template <class S>
static S function_of(int which, const S &x)
{
    switch (which) {
    case 0:
        return sin(x);
    case 1:
        return cos(x);
    case 2:
        return tanh(x);
    default:
        return exp(x);
    }
}

static void function(int which, int n, const double *x, double *y)
{
    for (int i = 0; i < n; i += LANES) {
        Pack<LANES> lanes(0.0);
        for (int k = 0; k < LANES && i + k < n; k++)
            lanes.set(k, x[i + k]);
        lanes = function_of(which, lanes);
        for (int k = 0; k < LANES && i + k < n; k++)
            y[i + k] = lanes[k];
    }
}

#define MK_STRING2(x) #x
#define MK_STRING(x) MK_STRING2(x)
extern const FastKernel kernel;
const FastKernel kernel = {MK_STRING(MK_ISA), LANES, run, function};

} // namespace MK_KERNEL_NS
} // namespace mk

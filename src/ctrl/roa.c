/* Estimated region of attraction of a balancing law (ctrl/roa.h): the level set
 *
 *     { e : V(e) <= level } ,   V(e) = e' P e ,   e the error from the equilibrium,
 *
 * P from the Riccati or Lyapunov equation of the linear law. V falls along trajectories of the
 * linear closed loop everywhere; what bounds the region is the limit of the command, friction and
 * the delay. So the level is found by simulation: the largest from whose surface the nominal model
 * recovers in all of a fixed set of directions, shrunk by SHRINK wherever one does not. It is no
 * proof: between the directions, and below a level at which a direction was tried, it is assumed.
 *
 * Directions are uniform in the coordinates in which the level set is a sphere: with P = L L' and s
 * on the unit sphere, e = L'^-1 s has V(e) = s's = 1, and sqrt(level) e lies on the surface. */
#include "ctrl/roa.h"

#include <string.h>

#include "ctrl/ctrl_priv.h"

#define N MK_CTRL_STATES
#define DIRECTIONS 160    /* tried on the surface of the level set */
#define LONGEST_RUN_S 3.0 /* s: a run that has not recovered by then is lost */
/* Factor on the level each time a direction fails. */
#define SHRINK 0.9
/* Least level, of the first guess: below, friction decides and not the law. */
#define SMALLEST_LEVEL 1e-5
/* V over the level at which a run has recovered, and at which it is lost. */
#define RECOVERED 0.05
#define ESCAPED 30.0
/* Least step of the calibration, s: faster loops are calibrated at this step, with its delay. */
#define CALIBRATION_DT 0.002
/* Step of mk_roa_leads_in(), s. */
#define LOOK_AHEAD_STEP 0.004

/* Where the model really stands in the turn that x is in: shift of the equilibrium, command that
 * holds it, and how much smaller its region is than the calibrated one (level). */
static const struct mk_standing *where(const struct mk_roa *roa, const double *x)
{
    static const struct mk_standing textbook = {{0.0, 0.0}, 0.0, true, 1.0};
    return roa->really ? mk_equilibria_at(roa->really, x) : &textbook;
}

double mk_roa_hold(const struct mk_roa *roa, const double *x)
{
    return where(roa, x)->u;
}

void mk_roa_error(const struct mk_roa *roa, const double *x, double *e)
{
    int motor = mk_plant(roa->model->plant)->motor_joint;
    const struct mk_standing *here = where(roa, x);
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        double error = x[j] - (roa->equilibrium[j] + here->shift[j]);
        e[j] = j == motor ? error : mk_wrap(error);
        e[2 + j] = x[2 + j];
    }
}

/* V(e) = e' P e. */
double mk_roa_value(const struct mk_roa *roa, const double *e)
{
    double sum = 0.0;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            sum += e[i] * roa->p[N * i + j] * e[j];
    return sum;
}

bool mk_roa_holds(const struct mk_roa *roa, const double *x, double share)
{
    double e[N];
    mk_roa_error(roa, x, e);
    return mk_roa_value(roa, e) <= share * where(roa, x)->level * roa->level;
}

static bool beyond_limit(const struct mk_roa *roa, const double *e)
{
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        if (roa->limit[j] > 0.0 && fabs(e[j]) > roa->limit[j])
            return true;
    return false;
}

bool mk_roa_leads_in(const struct mk_roa *roa, const double *x, double share, double horizon_s,
                     double u_share)
{
    double y[N], e[N], u_max = u_share * roa->model->u_max;
    memcpy(y, x, sizeof y);
    /* The nominal model under the law, its command kept within u_share of the limit, until it is
     * inside, out of the joints' limits, or out of time. The command acts at once: x is already
     * predicted to when it does. */
    for (double t = 0.0; t <= horizon_s; t += LOOK_AHEAD_STEP) {
        mk_roa_error(roa, y, e);
        const struct mk_standing *here = where(roa, y);
        if (here->found && mk_roa_value(roa, e) <= share * here->level * roa->level)
            return true;
        if (beyond_limit(roa, e))
            return false;
        double u = mk_clamp(roa->law(roa->user, y), -u_max, u_max);
        mk_ctrl_predict(roa->model, y, u, LOOK_AHEAD_STEP);
    }
    return false;
}

/* Runs the nominal closed loop from error e0. The command of a step is that of the step before, as
 * on a board with its one sample of delay, and the law sees the state that it will act on:
 *
 *     x_(k+1) = F(x_k, u_k) ,   u_(k+1) = law(F(x_k, u_k)) .
 *
 * Recovered: V <= RECOVERED level. Lost: V > ESCAPED level, not a number, or beyond a joint's
 * limit. */
static bool recovers(const struct mk_roa *roa, const double *e0, double level)
{
    const struct mk_standing *home = where(roa, roa->equilibrium);
    double dt = fmax(roa->dt, CALIBRATION_DT), u = home->u, x[N], ahead[N], e[N];
    for (int i = 0; i < N; i++)
        x[i] = e0[i] + (i < MK_MAX_JOINTS ? roa->equilibrium[i] + home->shift[i] : 0.0);
    for (double t = 0.0; t < LONGEST_RUN_S; t += dt) {
        memcpy(ahead, x, sizeof ahead);
        mk_ctrl_predict(roa->model, ahead, u, dt);
        double next = roa->law(roa->user, ahead);
        mk_ctrl_predict(roa->model, x, u, dt);
        u = next;
        mk_roa_error(roa, x, e);
        double value = mk_roa_value(roa, e);
        if (value <= RECOVERED * level)
            return true;
        if (!(value <= ESCAPED * level) || beyond_limit(roa, e))
            return false;
    }
    return false;
}

/* Lower triangle L with L L' = P over the coordinates that P weighs; rows of the others are 0.
 * False where P is not positive definite over them. */
static bool cholesky(const double *p, double *l)
{
    memset(l, 0, N * N * sizeof *l);
    for (int i = 0; i < N; i++) {
        if (p[N * i + i] == 0.0)
            continue;
        for (int j = 0; j <= i; j++) {
            if (p[N * j + j] == 0.0)
                continue;
            double sum = p[N * i + j];
            for (int k = 0; k < j; k++)
                sum -= l[N * i + k] * l[N * j + k];
            if (i == j && !(sum > 0.0))
                return false;
            l[N * i + j] = i == j ? sqrt(sum) : sum / l[N * j + j];
        }
    }
    return true;
}

/* Numbers in -0.5 .. 0.5 from a fixed sequence (Knuth's MMIX constants). */
static double draw(uint64_t *state)
{
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) / 9007199254740992.0 - 0.5;
}

/* A direction on the surface e' P e = 1: L' e = s by back substitution, s on the unit sphere.
 * Normal deviates over their norm are uniform on it. */
static void direction(const double *l, uint64_t *state, double *e)
{
    double s[N], norm = 0.0;
    for (int i = 0; i < N; i++) {
        s[i] = 0.0;
        for (int k = 0; k < 6 && l[N * i + i] > 0.0; k++) /* a sum of six is near to normal */
            s[i] += draw(state);
        norm += s[i] * s[i];
    }
    for (int i = N - 1; i >= 0; i--) {
        e[i] = 0.0;
        if (l[N * i + i] == 0.0)
            continue;
        double sum = s[i] / sqrt(norm);
        for (int k = i + 1; k < N; k++)
            sum -= l[N * k + i] * e[k];
        e[i] = sum / l[N * i + i];
    }
}

static bool recovers_along(const struct mk_roa *roa, const double *unit, double level)
{
    double e[N];
    for (int i = 0; i < N; i++)
        e[i] = unit[i] * sqrt(level);
    return recovers(roa, e, level);
}

enum mk_status mk_roa_estimate(struct mk_roa *roa, struct mk_error *err)
{
    double l[N * N], unit[N];
    if (!cholesky(roa->p, l))
        return mk_error_set(err, MK_ERR_NUMERIC, "region of attraction: the form is not positive");

    /* First guess: the level at which each angle alone may be off by a radian or more, since an
     * error of 1 in angle j alone has V = P_jj. */
    double first = fmax(roa->p[0], roa->p[N + 1]);
    double level = first;
    uint64_t state = 12345;
    /* Directions that have recovered are not tried again at a smaller level. */
    for (int n = 0; n < DIRECTIONS; n++) {
        direction(l, &state, unit);
        while (!recovers_along(roa, unit, level)) {
            level *= SHRINK;
            if (level < SMALLEST_LEVEL * first)
                return mk_error_set(err, MK_ERR_NUMERIC,
                                    "region of attraction: the law does not recover the believed "
                                    "model from any deviation");
        }
    }
    roa->level = level;
    return MK_OK;
}

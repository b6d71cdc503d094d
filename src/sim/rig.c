/* The virtual rig: a simulation seen through encoders. */
#include "mechkit/rig.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/random.h"
#include "sim/stiffness.h"

struct mk_rig {
    struct mk_model given; /* with spreads from log to log */
    struct mk_model model; /* as it is in this log */
    struct mk_rig_config config;
    struct mk_sim *sim;
    struct mk_random random;
    struct mk_random own; /* of values that a log has of its own */
    int joints;
    double count[MK_MAX_JOINTS]; /* its size, in the joint's unit */
    double rest[MK_MAX_JOINTS];
    int64_t zero[MK_MAX_JOINTS]; /* counts from hanging rest to where the counter was zeroed */
};

void mk_rig_config_default(struct mk_rig_config *config)
{
    memset(config, 0, sizeof *config);
}

static int64_t quantise(const struct mk_rig *rig, int j, double angle, double jitter)
{
    return (int64_t)floor((angle - rig->rest[j]) / rig->count[j] + jitter + 0.5);
}

/* The low 24 bits of a position, as a signed number: the counter chip has no more. */
static int32_t wrap(int64_t count)
{
    int unused = 32 - MK_COUNTER_BITS;
    return (int32_t)((uint32_t)(uint64_t)count << unused) >> unused;
}

enum mk_status mk_rig_create(const struct mk_model *model, const struct mk_rig_config *config,
                             struct mk_rig **out, struct mk_error *err)
{
    *out = NULL;
    enum mk_status st = mk_model_check_stiffness(model, err);
    if (st != MK_OK)
        return st;
    struct mk_rig *rig = calloc(1, sizeof *rig);
    if (!rig)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for the virtual rig");
    rig->given = *model;
    if (config)
        rig->config = *config;
    rig->joints = mk_model_joints(model);
    for (int j = 0; j < rig->joints; j++) {
        rig->count[j] = mk_model_count(model, j);
        rig->rest[j] = mk_plant(model->plant)->rest[j];
    }
    st = mk_rig_restart(rig, err);
    if (st != MK_OK) {
        mk_rig_destroy(rig);
        return st;
    }
    *out = rig;
    return MK_OK;
}

void mk_rig_destroy(struct mk_rig *rig)
{
    if (!rig)
        return;
    mk_sim_destroy(rig->sim);
    free(rig);
}

enum mk_status mk_rig_restart(struct mk_rig *rig, struct mk_error *err)
{
    double q[MK_MAX_JOINTS] = {0}, x[MK_MAX_STATES] = {0};
    rig->model = rig->given;
    for (int j = 0; j < rig->joints; j++)
        q[j] = rig->rest[j] + rig->config.start[j];
    mk_model_initial_state(&rig->model, q, rig->config.start_v, x);
    /* A new solver: a used one remembers its step sizes, and the last bits would differ. */
    mk_sim_destroy(rig->sim);
    enum mk_status st = mk_sim_create(&rig->model, &rig->config.sim, &rig->sim, err);
    if (st != MK_OK)
        return st;
    st = mk_sim_reset(rig->sim, 0.0, x, NULL);
    if (st != MK_OK)
        return mk_error_set(err, st, "the virtual rig cannot start from this position");
    rig->random.state = rig->config.seed;
    rig->own.state = ~rig->config.seed;
    mk_rig_zero(rig);
    return MK_OK;
}

enum mk_status mk_rig_advance(struct mk_rig *rig, double dt_s, double u, struct mk_error *err)
{
    double t = mk_sim_time(rig->sim), end = t + dt_s;
    if (!(dt_s >= 0.0))
        return mk_error_set(err, MK_ERR_RANGE, "time runs forwards");
    if (end <= t)
        return MK_OK;
    double limit = rig->model.u_max;
    double command[MK_MAX_INPUTS] = {fmax(-limit, fmin(limit, u)), 0.0};
    return mk_sim_advance(rig->sim, end, command, err);
}

void mk_rig_counts(struct mk_rig *rig, int32_t count[MK_MAX_JOINTS])
{
    double y[MK_MAX_JOINTS] = {0};
    mk_sim_measure(rig->sim, y);
    for (int j = 0; j < MK_MAX_JOINTS; j++) {
        count[j] = 0;
        if (j >= rig->joints)
            continue;
        double sd = rig->config.count_noise;
        double jitter = sd > 0.0 ? sd * mk_random_normal(&rig->random) : 0.0;
        count[j] = wrap(quantise(rig, j, y[j], jitter) - rig->zero[j]);
    }
}

/* Draws the values of a new log. */
static void draw_own_values(struct mk_rig *rig)
{
    rig->model = rig->given;
    for (int e = 0; e < rig->model.effect_count; e++) {
        struct mk_effect_use *use = &rig->model.effect[e];
        for (int k = 0; k < mk_effect(use->index)->parameter_count; k++) {
            const struct mk_parameter_info *info = &mk_effect(use->index)->parameter[k];
            if (!(use->spread[k] > 0.0))
                continue;
            use->value[k] += use->spread[k] * mk_random_normal(&rig->own);
            use->value[k] = fmax(info->min, fmin(info->max, use->value[k]));
            use->spread[k] = 0.0;
        }
    }
    /* Values within their ranges make no other structure, and no effect changes the mass matrix
     * for the worse: this cannot fail. */
    (void)!mk_sim_set_values(rig->sim, &rig->model, NULL);
}

void mk_rig_zero(struct mk_rig *rig)
{
    if (mk_model_has_own_values(&rig->given))
        draw_own_values(rig);
    const double *x = mk_sim_state(rig->sim);
    for (int j = 0; j < rig->joints; j++)
        rig->zero[j] = quantise(rig, j, x[j], 0.0);
}

double mk_rig_time(const struct mk_rig *rig)
{
    return mk_sim_time(rig->sim);
}

const double *mk_rig_state(const struct mk_rig *rig)
{
    return mk_sim_state(rig->sim);
}

const struct mk_model *mk_rig_model(const struct mk_rig *rig)
{
    return &rig->model;
}

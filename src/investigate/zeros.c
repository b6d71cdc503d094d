#include "investigate/zeros.h"

#include <math.h>
#include <string.h>

#include "mechkit/sim.h"

#define ZERO "encoder-offset"
#define SPREAD_RAD 0.002 /* from log to log, to start from */
#define SETTLE_S 30.0    /* of a model that is let go where the plant rests, */
#define MEAN_S 30.0      /* whose mean is then taken: small swings may go on */
#define LOOK_S 0.02
#define VARIES_COUNTS 0.5
#define OFF_RAD 1e-3 /* of a zero, at least, and so many counts */
#define OFF_COUNTS 1.5

static int zero_at(const struct mk_model *m, int joint)
{
    for (int e = 0; e < m->effect_count; e++)
        if (strcmp(mk_effect(m->effect[e].index)->name, ZERO) == 0 &&
            m->effect[e].joint == joint + 1)
            return e;
    return -1;
}

static bool hangs(const struct mk_model *m, int joint)
{
    const struct mk_plant_info *plant = mk_plant(m->plant);
    return !plant->joint_is_wheel[joint] && !plant->joint_is_level[joint];
}

void zeros_free(const struct mk_model *given, bool spread, struct mk_model *out)
{
    *out = *given;
    for (int j = 0; j < mk_model_joints(given); j++) {
        struct mk_model with = *out;
        if (!hangs(given, j) || zero_at(given, j) >= 0 ||
            mk_model_add_effect(&with, ZERO, j + 1, NULL) != MK_OK)
            continue;
        struct mk_effect_use *use = &with.effect[with.effect_count - 1];
        use->value[0] = 0.0;
        use->spread[0] = spread ? SPREAD_RAD * mk_model_joint_scale(given, j) : 0.0;
        *out = with;
    }
}

bool zeros_turned(const struct mk_model *given, bool spread, struct mk_model *out)
{
    const struct mk_plant_info *plant = mk_plant(given->plant);
    zeros_free(given, spread, out);
    for (int j = 0; j < plant->joints; j++) {
        struct mk_model with = *out;
        if (!plant->joint_is_level[j] || plant->joint_motion[j] == MK_JOINT_SLIDES ||
            zero_at(given, j) >= 0 || mk_model_add_effect(&with, ZERO, j + 1, NULL) != MK_OK)
            continue;
        with.effect[with.effect_count - 1].value[0] = 0.5 * M_PI;
        *out = with;
        return true;
    }
    return false;
}

void zeros_vary(struct mk_model *model, const struct mk_model *given)
{
    for (int j = 0; j < mk_model_joints(model); j++) {
        const int e = hangs(model, j) ? zero_at(model, j) : -1;
        if (e >= 0 && zero_at(given, j) < 0)
            model->effect[e].spread[0] =
                fmax(model->effect[e].spread[0], VARIES_COUNTS * mk_model_count(model, j));
    }
}

struct mk_model zeros_left_out(const struct mk_model *model, const struct mk_model *given)
{
    struct mk_model m = *model;
    for (int j = 0; j < mk_model_joints(model); j++) {
        const int e = hangs(model, j) ? zero_at(&m, j) : -1;
        if (e < 0 || zero_at(given, j) >= 0)
            continue;
        m.effect_count--;
        memmove(&m.effect[e], &m.effect[e + 1], (size_t)(m.effect_count - e) * sizeof *m.effect);
    }
    return m;
}

/* What the model reads at a joint where it comes to rest by itself, over what it reads where the
 * plant does: the mean of readings y, rest subtracted. False: it cannot be simulated. */
static bool rests_at(const struct mk_model *model, double mean[MK_MAX_JOINTS])
{
    const struct mk_plant_info *plant = mk_plant(model->plant);
    const double still[MK_MAX_JOINTS] = {0}, none[MK_MAX_INPUTS] = {0};
    double x[MK_MAX_STATES], y[MK_MAX_JOINTS];
    struct mk_sim *sim = NULL;
    int n = 0;
    mk_model_initial_state(model, plant->rest, still, x);
    bool well =
        mk_sim_create(model, NULL, &sim, NULL) == MK_OK && mk_sim_reset(sim, 0.0, x, NULL) == MK_OK;
    for (int j = 0; j < MK_MAX_JOINTS; j++)
        mean[j] = 0.0;
    for (double t = LOOK_S; well && t < SETTLE_S + MEAN_S; t += LOOK_S) {
        well = mk_sim_advance(sim, t, none, NULL) == MK_OK;
        if (!well || t < SETTLE_S)
            continue;
        mk_sim_measure(sim, y);
        n++;
        for (int j = 0; j < plant->joints; j++)
            mean[j] += (y[j] - plant->rest[j] - mean[j]) / n;
    }
    mk_sim_destroy(sim);
    return well;
}

bool zeros_are_off(const struct mk_explanation *e, const struct mk_model *given, int joint,
                   double *offset)
{
    const struct mk_model bare = zeros_left_out(&e->extended, given);
    const int number = zero_at(&e->extended, joint);
    double rest[MK_MAX_JOINTS];
    *offset = 0.0;
    if (number < 0 || !hangs(given, joint) || zero_at(given, joint) >= 0 || !rests_at(&bare, rest))
        return false;
    const struct mk_effect_use *use = &e->extended.effect[number];
    double least = fmax(OFF_RAD * mk_model_joint_scale(given, joint),
                        OFF_COUNTS * mk_model_count(given, joint));
    /* Dry friction may hold a link off where it would hang. */
    if (joint != mk_plant(given->plant)->motor_joint && isfinite(e->held_off[joint]))
        least += e->held_off[joint];
    *offset = use->value[0];
    /* A counter that is zeroed at rest reads y - rest there: the offset is minus that. */
    return fabs(*offset) > least + 3.0 * use->spread[0] &&
           fabs(*offset + rest[joint]) > least + 3.0 * use->spread[0];
}

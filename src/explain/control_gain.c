#include "explain/control_gain.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/random.h"
#include "experiment/robustness.h"
#include "mechkit/signal.h"

#define RUNS 5
#define HOPELESS 2 /* runs, the first ones, that fail: so do the others, and each takes long */
#define RATE_HZ 500.0
#define CATCH_S 6.0
#define HOLD_S 4.0
#define NOISE_COUNTS 0.3 /* readings flicker */
#define START_RAD 0.002  /* links never hang quite the same */
#define STEP_RADPS 20.0  /* of the speed that is tracked, both ways */
#define STEPS "%.9g*square(0.25)"

static int by_size(const void *a, const void *b)
{
    double d = *(const double *)a - *(const double *)b;
    return (d > 0.0) - (d < 0.0);
}

/* Of the numbers among them; NAN when there is none. */
static double median(const double *value, int count)
{
    double sorted[RUNS];
    int n = 0;
    for (int i = 0; i < count; i++)
        if (isfinite(value[i]))
            sorted[n++] = value[i];
    if (n == 0)
        return NAN;
    qsort(sorted, (size_t)n, sizeof *sorted, by_size);
    return 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
}

static bool went_well(const struct trial *t)
{
    /* A link that leans because its equilibrium does is held all the same. */
    return t->end == TRIAL_HELD || t->end == TRIAL_NOT_STILL;
}

static void sum_up(const struct trial *trial, int count, struct mk_control_figures *out)
{
    double caught[RUNS], error[RUNS], off[RUNS], effort[RUNS], peak[RUNS];
    int held = 0;
    for (int i = 0; i < count; i++) {
        const struct trial *t = &trial[i];
        bool well = went_well(t);
        held += well;
        caught[i] = t->caught_s;
        error[i] = !well ? (double)NAN : isnan(t->track_radps) ? t->sway_rad : t->track_radps;
        off[i] = well ? t->off_rad : (double)NAN;
        effort[i] = well ? t->effort : (double)NAN;
        peak[i] = t->u_peak;
    }
    *out = (struct mk_control_figures){.held = (double)held / RUNS,
                                       .caught_s = median(caught, count),
                                       .error = median(error, count),
                                       .off = median(off, count),
                                       .effort = median(effort, count),
                                       .peak = median(peak, count)};
}

struct virtual_rig {
    struct mk_model model;
    double start_rad[MK_MAX_JOINTS];
    struct mk_signal *steps;
};

static enum mk_status try_nominal(const struct mk_ctrl_ops *setup, const struct mk_model *nominal,
                                  const struct virtual_rig *rig, struct mk_control_figures *out,
                                  struct mk_error *err)
{
    struct mk_ctrl *ctrl = NULL;
    struct trial trial[RUNS];
    enum mk_status st = mk_ctrl_create(setup, nominal, 1.0 / RATE_HZ, rig->steps, &ctrl, err);
    int done = 0, well = 0;
    while (st == MK_OK && done < RUNS && (well > 0 || done < HOPELESS)) {
        const int i = done++;
        struct mk_random random = {(uint64_t)i + 1};
        struct trial_setting setting = {.rig = &rig->model,
                                        .rate_hz = RATE_HZ,
                                        .catch_s = CATCH_S,
                                        .hold_s = HOLD_S,
                                        .count_noise = NOISE_COUNTS,
                                        .seed = (uint64_t)i + 1};
        for (int j = 0; j < MK_MAX_JOINTS; j++)
            setting.start_rad[j] =
                rig->start_rad[j] + START_RAD * (2.0 * mk_random_uniform(&random) - 1.0);
        st = trial_run_on(ctrl, &setting, &trial[i], err);
        well += st == MK_OK && went_well(&trial[i]);
    }
    mk_ctrl_destroy(ctrl);
    if (st == MK_OK)
        sum_up(trial, done, out);
    return st;
}

/* False: this setup says nothing about this rig. */
static bool try_setup(const struct mk_ctrl_ops *setup, const struct mk_explanation *e,
                      const struct virtual_rig *rig, struct mk_control_gain *out)
{
    *out = (struct mk_control_gain){.setup = setup->name, .runs = RUNS};
    if (try_nominal(setup, &e->given, rig, &out->given, NULL) != MK_OK ||
        try_nominal(setup, &e->refit, rig, &out->refit, NULL) != MK_OK ||
        try_nominal(setup, &e->extended, rig, &out->extended, NULL) != MK_OK)
        return false;
    return out->given.held + out->refit.held + out->extended.held > 0.0;
}

enum mk_status control_gain_measure(struct mk_explanation *e, struct mk_error *err)
{
    struct virtual_rig rig = {.steps = NULL};
    e->control_count = 0;
    if (!e->offered || trial_hang(&e->extended, &rig.model, rig.start_rad, NULL) != MK_OK)
        return MK_OK;
    char steps[48];
    int motor = mk_plant(e->given.plant)->motor_joint;
    snprintf(steps, sizeof steps, STEPS, STEP_RADPS * mk_model_joint_scale(&e->given, motor));
    enum mk_status st = mk_signal_create(steps, &rig.steps, err);
    const struct mk_ctrl_ops *setup;
    for (int i = 0; st == MK_OK && (setup = mk_ctrl_setup(i)) != NULL; i++) {
        bool ours = (setup->plants & (1u << e->extended.plant)) &&
                    mk_ctrl_param_index(setup, "compensate") >= 0;
        if (ours && e->control_count < MK_MAX_CONTROL_GAINS)
            e->control_count += try_setup(setup, e, &rig, &e->control[e->control_count]);
    }
    mk_signal_destroy(rig.steps);
    return st;
}

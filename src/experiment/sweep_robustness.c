/* Sweeps of robustness runs, and of start states that a setup recovers from. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "ctrl/ctrl_rig.h"
#include "experiment/basin.h"
#include "experiment/robustness.h"
#include "experiment/sweep.h"
#include "mechkit/loop.h"

/* --- what both have in common --------------------------------------------------------------- */

/* clang-format off */
#define SPREAD_KEYS                                                                                \
    {"spread", "parameters", SWEEP_NUMBER, 0.0, 0.95},                                             \
    {"spread", "friction", SWEEP_NUMBER, 0.0, 1.0},                                                \
    {"spread", "offset", SWEEP_NUMBER, 0.0, 1000.0},                                               \
    {"spread", "delay", SWEEP_WHOLE, 0.0, 100.0},                                                  \
    {"loop", "rate", SWEEP_NUMBER, MK_LOOP_RATE_MIN_HZ, MK_LOOP_RATE_MAX_HZ}
/* clang-format on */

static enum mk_status check_setup(const struct sweep *s, const struct sweep_axis *a,
                                  const char *name, struct mk_error *err)
{
    char known[200] = "";
    for (int i = 0; mk_ctrl_setup(i); i++) {
        const struct mk_ctrl_ops *setup = mk_ctrl_setup(i);
        if (!linear_equilibrium(mk_ctrl_first_rig(setup), setup->name))
            continue;
        if (strcmp(setup->name, name) == 0)
            return MK_OK;
        snprintf(known + strlen(known), sizeof known - strlen(known), "%s%s", *known ? ", " : "",
                 setup->name);
    }
    return sweep_refuse(s, a, err, "'%s' is no setup that balances: expected %s", name, known);
}

/* Every parameter must be one of every setup, and every value in its range. */
static enum mk_status check_gains(const struct sweep *s, const struct sweep_axis *setups,
                                  const struct sweep_axis *a, struct mk_error *err)
{
    const char *name = strchr(a->name, '.') + 1;
    for (int i = 0; i < setups->count; i++) {
        const struct mk_ctrl_ops *setup = mk_ctrl_setup_by_name(setups->word[i]);
        int index = mk_ctrl_param_index(setup, name);
        if (index < 0)
            return sweep_refuse(s, a, err, "setup %s has no parameter '%s'", setup->name, name);
        for (int k = 0; k < a->count; k++) {
            struct mk_error why = MK_ERROR_INIT;
            if (mk_ctrl_check(setup, index, a->value[k], &why) != MK_OK)
                return sweep_refuse(s, a, err, "%s", why.message);
        }
    }
    return MK_OK;
}

static enum mk_status prepare(struct sweep *s, struct mk_error *err)
{
    int at = sweep_find(s, "rig.setup");
    if (at < 0)
        return mk_error_at(err, MK_ERR_PARSE, s->path, 0, 0,
                           "[rig] setup is missing: which setups are to be swept?");
    const struct sweep_axis *setups = &s->axis[at];
    enum mk_status st = MK_OK;
    for (int i = 0; i < setups->count && st == MK_OK; i++)
        st = check_setup(s, setups, setups->word[i], err);
    for (int i = 0; i < s->axis_count && st == MK_OK; i++)
        if (!s->axis[i].key)
            st = check_gains(s, setups, &s->axis[i], err);
    return st;
}

static const struct mk_ctrl_ops *setup_of(const struct sweep *s, size_t index)
{
    return mk_ctrl_setup_by_name(sweep_word(s, index, "rig.setup", ""));
}

static void spread_of(const struct sweep *s, size_t index, struct trial_spread *out)
{
    trial_spread_default(out);
    out->parameters = sweep_number(s, index, "spread.parameters", out->parameters);
    out->friction = sweep_number(s, index, "spread.friction", out->friction);
    out->offset_counts = sweep_number(s, index, "spread.offset", out->offset_counts);
    out->delay_samples = (int)sweep_number(s, index, "spread.delay", out->delay_samples);
    out->rate_hz = sweep_number(s, index, "loop.rate", out->rate_hz);
    for (int i = 0; i < s->axis_count; i++) {
        const struct sweep_axis *a = &s->axis[i];
        if (a->key)
            continue;
        struct trial_change *c = &out->change[out->change_count++];
        c->index = mk_ctrl_param_index(setup_of(s, index), strchr(a->name, '.') + 1);
        c->value = a->value[sweep_at(s, index, i)];
    }
}

/* --- robustness ----------------------------------------------------------------------------- */

static const struct sweep_key robustness_keys[] = {{"rig", "setup", SWEEP_WORDS, 0, 0},
                                                   SPREAD_KEYS,
                                                   {"trial", "catch", SWEEP_NUMBER, 0.1, 600.0},
                                                   {"trial", "hold", SWEEP_NUMBER, 0.1, 3600.0},
                                                   {NULL, NULL, SWEEP_NUMBER, 0, 0}};

static enum mk_status run_robustness(const struct sweep *s, size_t index, int *outcome,
                                     char text[SWEEP_LINE], struct mk_error *err)
{
    struct trial_spread spread;
    struct trial t;
    spread_of(s, index, &spread);
    spread.catch_s = sweep_number(s, index, "trial.catch", spread.catch_s);
    spread.hold_s = sweep_number(s, index, "trial.hold", spread.hold_s);
    const struct mk_ctrl_ops *setup = setup_of(s, index);
    enum mk_status st = trial_run(setup, &s->model[mk_ctrl_first_rig(setup)], &spread,
                                  sweep_seed(s, index), &t, err);
    if (st != MK_OK)
        return st;
    *outcome = (int)t.end;
    sweep_put(text, 0, t.caught_s);
    sweep_put(text, 1, t.falls);
    sweep_put(text, 2, t.u_peak);
    sweep_put(text, 3, t.tilt_rad);
    sweep_put(text, 4, t.travel_rad);
    return MK_OK;
}

const struct sweep_kind sweep_robustness = {
    .name = "robustness",
    .key = robustness_keys,
    .free_section = "gains",
    .default_runs = 100,
    .batch = 16,
    .outcome = {"held", "never caught", "caught and fell", "held but not still", "fault"},
    .successes = 1,
    .columns = "caught_s,falls,u_peak,tilt_rad,travel_rad",
    .prepare = prepare,
    .run = run_robustness,
};

/* --- basin of attraction -------------------------------------------------------------------- */

static const struct sweep_key basin_keys[] = {{"rig", "setup", SWEEP_WORDS, 0, 0},
                                              {"start", "q1", SWEEP_NUMBER, -100.0, 100.0},
                                              {"start", "q2", SWEEP_NUMBER, -100.0, 100.0},
                                              {"start", "v1", SWEEP_NUMBER, -1000.0, 1000.0},
                                              {"start", "v2", SWEEP_NUMBER, -1000.0, 1000.0},
                                              SPREAD_KEYS,
                                              {"trial", "within", SWEEP_NUMBER, 0.01, 60.0},
                                              {"trial", "hold", SWEEP_NUMBER, 0.1, 600.0},
                                              {NULL, NULL, SWEEP_NUMBER, 0, 0}};

static enum mk_status run_basin(const struct sweep *s, size_t index, int *outcome,
                                char text[SWEEP_LINE], struct mk_error *err)
{
    static const char *const start[] = {"start.q1", "start.q2", "start.v1", "start.v2"};
    struct basin_start from = {0};
    struct trial_spread spread;
    struct basin_run run;
    spread_of(s, index, &spread);
    for (int i = 0; i < 4; i++)
        from.off[i] = sweep_number(s, index, start[i], 0.0);
    from.within_s = sweep_number(s, index, "trial.within", 0.1);
    from.hold_s = sweep_number(s, index, "trial.hold", 3.0);
    const struct mk_ctrl_ops *setup = setup_of(s, index);
    enum mk_status st = basin_run(setup, &s->model[mk_ctrl_first_rig(setup)], &spread, &from,
                                  sweep_seed(s, index), &run, err);
    if (st != MK_OK)
        return st;
    *outcome = (int)run.end;
    sweep_put(text, 0, run.caught_s);
    sweep_put(text, 1, run.u_peak);
    sweep_put(text, 2, run.tilt_rad);
    return MK_OK;
}

const struct sweep_kind sweep_basin = {
    .name = "basin",
    .key = basin_keys,
    .free_section = "gains",
    .default_runs = 1,
    .batch = 64,
    .outcome = {"held", "not caught", "fell"},
    .successes = 1,
    .columns = "caught_s,u_peak,tilt_rad",
    .prepare = prepare,
    .run = run_basin,
};

/* Control with the model that was given and with the one that was found: every set-up that can
 * compensate for effects is tried on the rig with both. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "investigate/investigation.h"

#define CATCH_S 10.0
#define HOLD_S 6.0

static bool suits(const struct mk_ctrl_ops *setup, const struct mk_model *model)
{
    return (setup->plants & (1u << model->plant)) && mk_ctrl_param_index(setup, "compensate") >= 0;
}

static bool done_already(const struct journal *j, const char *setup, const char *nominal)
{
    for (int i = 0; i < j->controls; i++)
        if (strcmp(j->control[i].setup, setup) == 0 && strcmp(j->control[i].nominal, nominal) == 0)
            return true;
    return false;
}

/* Where nothing is caught, a speed is held. */
static const char *how_it_held(const struct journal_control *c, const struct mk_model *given,
                               char *buf, size_t size)
{
    const int motor = mk_plant(given->plant)->motor_joint;
    if (!c->held)
        snprintf(buf, size, "not held");
    else if (isfinite(c->caught_s))
        snprintf(buf, size, "held, caught after %.3g s, sway %.3g mrad, rms command %.3g",
                 c->caught_s, 1e3 * c->sway, c->effort);
    else
        snprintf(buf, size, "held, off by %.3g %s rms, rms command %.3g", c->sway,
                 mk_model_unit(given, motor, "rad/s"), c->effort);
    return buf;
}

static enum mk_status try_setup(struct investigation *v, const struct mk_ctrl_ops *setup,
                                const struct mk_model *nominal, const char *name,
                                struct mk_error *err)
{
    struct journal *j = v->j;
    char path[JOURNAL_PATH];
    if (j->controls >= JOURNAL_CONTROLS || done_already(j, setup->name, name))
        return MK_OK;
    struct journal_control c = {.caught_s = NAN};
    snprintf(c.setup, sizeof c.setup, "%s", setup->name);
    snprintf(c.nominal, sizeof c.nominal, "%s", name);
    snprintf(c.log, sizeof c.log, "control-%s-%s.csv", setup->name, name);
    /* A log of a run that was killed is kept. */
    for (int i = 2; i < 100 && access(journal_file(j, path, c.log), F_OK) == 0; i++)
        snprintf(c.log, sizeof c.log, "control-%s-%s-%d.csv", setup->name, name, i);
    struct rig_run run = {.nominal = nominal, .log = journal_file(j, path, c.log)};
    struct rig_figures f;
    const double begin = rig_seconds(&v->rig);
    enum mk_status st = rig_rest(&v->rig, err);
    if (st == MK_OK)
        st = rig_control(&v->rig, &run, setup, CATCH_S, HOLD_S, &f, err);
    if (st != MK_OK)
        return st;
    if (rig_fault_is_of_the_board(run.fault))
        return mk_error_set(err, MK_ERR_FAULT,
                            "setup %s: fault %s; motor off. When that is put right, the same "
                            "command goes on",
                            setup->name, run.fault_text);
    c.held = f.held;
    c.caught_s = f.caught_s;
    c.sway = f.sway;
    c.effort = f.effort;
    snprintf(c.fault, sizeof c.fault, "%s", run.fault_text);
    j->control[j->controls++] = c;
    j->control_s += rig_seconds(&v->rig) - begin;
    char held[120];
    investigation_say(v, "  %s, believing the %s model: %s%s%s", setup->name, name,
                      how_it_held(&c, &j->given, held, sizeof held), c.fault[0] ? "; " : "",
                      c.fault);
    return investigation_save(v, err);
}

enum mk_status investigation_control(struct investigation *v, struct mk_error *err)
{
    const struct mk_ctrl_ops *setup;
    enum mk_status st = MK_OK;
    for (int i = 0; st == MK_OK && (setup = mk_ctrl_setup(i)) != NULL; i++) {
        if (!suits(setup, &v->j->given))
            continue;
        st = try_setup(v, setup, &v->j->given, "given", err);
        if (st == MK_OK)
            st = try_setup(v, setup, &v->model, "final", err);
    }
    return st;
}

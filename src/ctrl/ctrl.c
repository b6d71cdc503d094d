#include "mechkit/ctrl.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ctrl/compensate.h"
#include "ctrl/ctrl_priv.h"
#include "ctrl/ctrl_rig.h"
#include "ctrl/track.h"

/* One row a setup: the order is the one of lists shown to people. */
static const struct mk_ctrl_ops *const setups[] = {
    &mk_ctrl_pendubot_mid, &mk_ctrl_pendubot_top, &mk_ctrl_reaction_wheel, &mk_ctrl_furuta,
    &mk_ctrl_cart_pole,    &mk_ctrl_acrobot,      &mk_ctrl_pi_speed,       &mk_ctrl_open_loop,
};

const struct mk_ctrl_ops *mk_ctrl_setup(int index)
{
    int count = (int)(sizeof setups / sizeof setups[0]);
    return index >= 0 && index < count ? setups[index] : NULL;
}

const struct mk_ctrl_ops *mk_ctrl_setup_by_name(const char *name)
{
    const struct mk_ctrl_ops *ops;
    for (int i = 0; (ops = mk_ctrl_setup(i)) != NULL; i++)
        if (strcmp(ops->name, name) == 0)
            return ops;
    return NULL;
}

const char *mk_phase_name(enum mk_phase phase)
{
    switch (phase) {
    case MK_PHASE_IDLE:
        return "idle";
    case MK_PHASE_SWINGUP:
        return "swing-up";
    case MK_PHASE_BALANCE:
        return "balance";
    case MK_PHASE_TRACK:
        return "track";
    }
    return "?";
}

int mk_ctrl_param_index(const struct mk_ctrl_ops *ops, const char *name)
{
    for (int i = 0; i < ops->param_count; i++)
        if (strcmp(ops->param[i].name, name) == 0)
            return i;
    return -1;
}

int mk_ctrl_gain_count(const struct mk_ctrl_ops *ops)
{
    int count = 0;
    for (int i = 0; i < ops->param_count; i++)
        count += ops->param[i].gain;
    return count;
}

enum mk_status mk_ctrl_check(const struct mk_ctrl_ops *ops, int index, double value,
                             struct mk_error *err)
{
    if (index < 0 || index >= ops->param_count)
        return mk_error_set(err, MK_ERR_NOTFOUND, "setup %s has no parameter number %d", ops->name,
                            index);
    const struct mk_ctrl_param *p = &ops->param[index];
    if (!(value >= p->min && value <= p->max)) /* also refuses NaN */
        return mk_error_set(err, MK_ERR_RANGE, "%s: %s = %g is outside %g .. %g%s%s", ops->name,
                            p->name, value, p->min, p->max, p->unit[0] ? " " : "", p->unit);
    return MK_OK;
}

/* "pendubot, furuta" */
static void list_plants(unsigned plants, char *buf, size_t size)
{
    size_t used = 0;
    buf[0] = '\0';
    for (int k = 0; k < MK_PLANT_COUNT; k++) {
        if (!(plants & (1u << k)) || used >= size)
            continue;
        used += (size_t)snprintf(buf + used, size - used, "%s%s", used ? ", " : "",
                                 mk_plant((enum mk_plant_kind)k)->name);
    }
}

enum mk_status mk_ctrl_check_rig(const struct mk_ctrl_ops *ops, enum mk_plant_kind rig,
                                 struct mk_error *err)
{
    char rigs[128];
    if (ops->plants & (1u << rig))
        return MK_OK;
    list_plants(ops->plants, rigs, sizeof rigs);
    return mk_error_set(err, MK_ERR_INVALID, "setup %s is for %s, not for %s", ops->name, rigs,
                        mk_plant(rig)->name);
}

enum mk_plant_kind mk_ctrl_first_rig(const struct mk_ctrl_ops *ops)
{
    int kind = 0;
    while (!(ops->plants & (1u << kind)))
        kind++;
    return (enum mk_plant_kind)kind;
}

static enum mk_status check_fit(const struct mk_ctrl_ops *ops, const struct mk_model *nominal,
                                double dt, struct mk_error *err)
{
    enum mk_status st = mk_model_check(nominal, err);
    if (st != MK_OK)
        return st;
    st = mk_ctrl_check_rig(ops, nominal->plant, err);
    if (st != MK_OK)
        return st;
    if (!(dt > 0.0 && dt <= 0.1))
        return mk_error_set(err, MK_ERR_RANGE, "sample time %g s is outside 0 .. 0.1 s", dt);
    return MK_OK;
}

/* Every value is known and in its range, also those that were designed. */
static enum mk_status check_values(const struct mk_ctrl *ctrl, struct mk_error *err)
{
    for (int i = 0; i < ctrl->ops->param_count; i++) {
        enum mk_status st = mk_ctrl_check(ctrl->ops, i, ctrl->value[i], err);
        if (st != MK_OK)
            return mk_error_set(err, MK_ERR_NUMERIC,
                                "setup %s: no usable %s can be designed for this model (%g)",
                                ctrl->ops->name, ctrl->ops->param[i].name, ctrl->value[i]);
    }
    return MK_OK;
}

#define COMPENSATE "compensate"

static enum mk_status prepare_compensation(struct mk_ctrl *ctrl, struct mk_error *err)
{
    if (mk_ctrl_param_index(ctrl->ops, COMPENSATE) < 0 || ctrl->model.effect_count == 0)
        return MK_OK;
    return mk_compensator_create(&ctrl->model, ctrl->dt, &ctrl->compensator, err);
}

static double compensated_share(const struct mk_ctrl *ctrl)
{
    return ctrl->compensator ? ctrl->value[mk_ctrl_param_index(ctrl->ops, COMPENSATE)] : 0.0;
}

enum mk_status mk_ctrl_create(const struct mk_ctrl_ops *ops, const struct mk_model *nominal,
                              double dt, const struct mk_signal *signal, struct mk_ctrl **out,
                              struct mk_error *err)
{
    *out = NULL;
    enum mk_status st = check_fit(ops, nominal, dt, err);
    if (st != MK_OK)
        return st;

    struct mk_ctrl *ctrl = calloc(1, sizeof *ctrl);
    if (!ctrl)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for setup %s", ops->name);
    ctrl->ops = ops;
    ctrl->model = *nominal;
    ctrl->dt = dt;
    ctrl->ref = signal;
    for (int i = 0; i < ops->param_count; i++)
        ctrl->value[i] = ops->param[i].initial;
    ctrl->priv = calloc(1, ops->private_size ? ops->private_size : 1);
    if (!ctrl->priv) {
        st = mk_error_set(err, MK_ERR_NOMEM, "no memory for setup %s", ops->name);
        goto fail;
    }
    if (ops->create && (st = ops->create(ctrl, err)) != MK_OK)
        goto fail;
    if ((st = check_values(ctrl, err)) != MK_OK ||
        (st = prepare_compensation(ctrl, err)) != MK_OK) {
        if (ops->destroy)
            ops->destroy(ctrl);
        goto fail;
    }
    if (ops->changed)
        ops->changed(ctrl);
    mk_ctrl_reset(ctrl);
    *out = ctrl;
    return MK_OK;

fail:
    free(ctrl->priv);
    free(ctrl);
    return st;
}

void mk_ctrl_destroy(struct mk_ctrl *ctrl)
{
    if (!ctrl)
        return;
    if (ctrl->ops->destroy)
        ctrl->ops->destroy(ctrl);
    mk_compensator_destroy(ctrl->compensator);
    mk_track_destroy(ctrl->track);
    free(ctrl->priv);
    free(ctrl);
}

void mk_ctrl_reset(struct mk_ctrl *ctrl)
{
    if (ctrl->compensator)
        mk_compensator_reset(ctrl->compensator);
    mk_track_reset(ctrl->track);
    ctrl->ops->reset(ctrl);
}

void mk_ctrl_step(struct mk_ctrl *ctrl, const struct mk_ctrl_input *in, struct mk_ctrl_output *out)
{
    double share = compensated_share(ctrl);
    if (!(share > 0.0) || !mk_ctrl_input_ok(ctrl, in)) {
        ctrl->ops->step(ctrl, in, out);
        return;
    }
    struct mk_ctrl_input seen;
    mk_compensator_before(ctrl->compensator, in, &seen);
    ctrl->ops->step(ctrl, &seen, out);
    mk_compensator_after(ctrl->compensator, in, share, out);
}

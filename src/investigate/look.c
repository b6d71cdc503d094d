/* The first look at a rig: it rests, and a short push moves it as the model says. */
#include <math.h>
#include <stdio.h>

#include "base/origin.h"
#include "investigate/investigation.h"
#include "investigate/nudge.h"

#define NO_COUNT_RAD 1e-3 /* an encoder that counts no more than that stands still */

static bool an_encoder_is_dead(const struct rig_nudge *n, int joints)
{
    for (int j = 0; j < joints; j++)
        if (fabs(n->moved[j]) < NO_COUNT_RAD && fabs(n->expected[j]) > 10.0 * NO_COUNT_RAD)
            return true;
    return false;
}

static enum mk_status wrong_wiring(const struct rig_nudge *n, const struct mk_model *model,
                                   struct mk_error *err)
{
    char moved[RIG_MOTION_TEXT], expected[RIG_MOTION_TEXT];
    if (n->misfit > RIG_MISFIT)
        return mk_error_set(err, MK_ERR_EXPECT,
                            "a short push moved the joints by %s, the model says %s, and no wiring "
                            "explains that: is this the model of this rig? encoders plugged in? "
                            "power supply on?",
                            rig_motion_text(model, n->moved, moved, sizeof moved),
                            rig_motion_text(model, n->expected, expected, sizeof expected));
    for (int j = 0; j < mk_model_joints(model); j++)
        if (fabs(n->moved[j]) < NO_COUNT_RAD && fabs(n->expected[j]) > 10.0 * NO_COUNT_RAD)
            return mk_error_set(err, MK_ERR_EXPECT,
                                "encoder %d did not count as a short push moved its joint by "
                                "%+.4f %s, as the model says: is this the model of this rig? its "
                                "plug and cable?",
                                j + 1, n->expected[j] * mk_model_joint_scale(model, j),
                                mk_model_unit(model, j, "rad"));
    if (n->wiring.swapped)
        return mk_error_set(err, MK_ERR_EXPECT,
                            "the encoders are swapped: exchange their plugs at the board");
    if (n->wiring.sign[0] < 0 && n->wiring.sign[1] < 0)
        return mk_error_set(err, MK_ERR_EXPECT,
                            "the motor turns backwards: exchange its two wires");
    return mk_error_set(err, MK_ERR_EXPECT,
                        "encoder %d counts backwards: exchange its A and B wires",
                        n->wiring.sign[0] < 0 ? 1 : 2);
}

enum mk_status investigation_look(struct investigation *v, struct mk_error *err)
{
    struct rig_nudge n;
    struct journal *j = v->j;
    const double begin = rig_seconds(&v->rig);
    enum mk_status st = rig_rest(&v->rig, err);
    if (st != MK_OK)
        return st;
    struct mk_model gentle = j->given; /* the push stays within the operator's limit, too */
    if (isfinite(j->settings.limits.u_max))
        gentle.u_max = fmin(gentle.u_max, j->settings.limits.u_max / RIG_PUSH_SHARE);
    if (!rig_nudge(v->rig.board, &gentle, v->o->cancel, &n))
        return investigation_cancelled(v)
                   ? mk_error_set(err, MK_ERR_INTR, "ended by a signal, motor off")
                   : mk_error_set(err, MK_ERR_FAULT,
                                  "the first short push was broken off, the board tripped or is "
                                  "gone: check cable and power. The same command goes on");
    const int joints = mk_model_joints(&j->given);
    if (!rig_nudge_is_well(&n) || an_encoder_is_dead(&n, joints))
        return wrong_wiring(&n, &j->given, err);
    const int motor = mk_plant(j->given.plant)->motor_joint;
    const double size = mk_model_joint_scale(&j->given, motor);
    snprintf(j->looked, sizeof j->looked,
             "The links hang still; a short push moved joint %d by %+.4f %s, both ways, the model "
             "says %+.4f: motor and encoders are wired as the model has it.",
             motor + 1, n.moved[motor] * size, mk_model_unit(&j->given, motor, "rad"),
             n.expected[motor] * size);
    (void)mk_date_text(j->looked_at);
    j->look_s = rig_seconds(&v->rig) - begin;
    investigation_say(v, "%s", j->looked);
    return investigation_save(v, err);
}

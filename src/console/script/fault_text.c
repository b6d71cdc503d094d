#include "console/script/fault_text.h"

#include <stdio.h>

const char *fault_value(const struct mk_loop_snapshot *snap, const struct mk_safety_limits *limits,
                        const struct mk_model *model, char *buf, size_t size)
{
    const struct mk_sample *s = &snap->at_fault;
    const int j = snap->fault_joint - 1;
    buf[0] = '\0';
    if (snap->fault == MK_FAULT_STUCK && j < 0)
        snprintf(buf, size,
                 "no encoder counts, u %.4g, and by the model the rig cannot rest so: see whether "
                 "they have their supply",
                 s->u);
    if (j < 0 || j >= mk_model_joints(model))
        return buf;
    const char *unit = mk_model_unit(model, j, "rad");
    switch (snap->fault) {
    case MK_FAULT_TRAVEL:
        snprintf(buf, size, "q%d %.4g %s, limits %.4g .. %.4g %s", j + 1, s->q[j], unit,
                 limits->q_min[j], limits->q_max[j], unit);
        break;
    case MK_FAULT_SPEED:
        snprintf(buf, size, "dq%d %.4g %s/s, limit %.4g %s/s", j + 1, s->v[j], unit,
                 limits->v_max[j], unit);
        break;
    case MK_FAULT_JUMP:
        snprintf(buf, size,
                 "q%d came to %.4g %s; limits: %.4g %s from one sample to the next, or what the "
                 "model lets the joint go",
                 j + 1, s->q[j], unit, limits->jump_rad[j], unit);
        break;
    case MK_FAULT_STUCK:
        snprintf(buf, size,
                 "q%d stands at %.4g %s, u %.4g; limits: %.3g s at |u| above %.3g, or %.3g %s that "
                 "the joint must have gone by the model",
                 j + 1, s->q[j], unit, s->u, limits->stuck_s, limits->stuck_u, limits->still_way[j],
                 unit);
        break;
    case MK_FAULT_DRIVEN:
        snprintf(buf, size, "dq%d %.4g %s/s, u %.4g", j + 1, s->v[j], unit, s->u);
        break;
    case MK_FAULT_RUNAWAY:
        snprintf(buf, size, "q%d %.4g %s, dq%d %.4g %s/s, against u %.4g", j + 1, s->q[j], unit,
                 j + 1, s->v[j], unit, s->u);
        break;
    default:
        break;
    }
    return buf;
}

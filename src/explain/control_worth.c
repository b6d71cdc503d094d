/* Whether a controller should be given what was found: its own trial decides, whatever the model is
 * worth to a simulation. */
#include <math.h>

#include "mechkit/explain.h"

/* What counts as later or less still. Below, runs of the same rig differ from each other. */
#define LATER_SHARE 1.25
#define LATER_S 0.5
#define MORE_SHARE 1.25
#define MORE_SWAY_RAD 5e-4
#define MORE_SPEED_ERROR 0.05 /* rad/s or m/s */

static bool more(double now, double before, double share, double least)
{
    return isfinite(before) && isfinite(now) && now > share * before && now > before + least;
}

static const char *than(const struct mk_control_figures *now,
                        const struct mk_control_figures *before)
{
    const bool tracks = isnan(now->off) && isnan(before->off);
    if (now->held < before->held)
        return "holds fewer runs";
    if (now->held > before->held)
        return NULL;
    if (more(now->caught_s, before->caught_s, LATER_SHARE, LATER_S))
        return "catches later";
    if (more(now->error, before->error, MORE_SHARE, tracks ? MORE_SPEED_ERROR : MORE_SWAY_RAD))
        return tracks ? "follows less closely" : "sways more";
    return NULL;
}

const char *mk_control_gain_worse(const struct mk_control_gain *gain, const char **believing)
{
    const char *why = than(&gain->extended, &gain->refit);
    *believing = "refitted";
    if (!why) {
        why = than(&gain->extended, &gain->given);
        *believing = "given";
    }
    return why;
}

bool mk_explanation_misleads_control(const struct mk_explanation *explanation)
{
    const char *believing;
    for (int i = 0; i < explanation->control_count; i++)
        if (mk_control_gain_worse(&explanation->control[i], &believing))
            return true;
    return false;
}

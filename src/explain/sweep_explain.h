/* What a sweep of explain makes of an answer (sweep_explain.c). */
#ifndef MECHKIT_EXPLAIN_SWEEP_EXPLAIN_H
#define MECHKIT_EXPLAIN_SWEEP_EXPLAIN_H

#include "mechkit/explain.h"

#ifdef __cplusplus
extern "C" {
#endif

/* In the order of sweep_explain.outcome. RIGHT: the effect is the first cause, or nothing is hidden
 * and nothing said; TIED: it is another of the causes, or a rival that the data do not tell apart;
 * WRONG: something else is named; MISSED: no effect is claimed; UNKNOWN: the verdict; FAILED:
 * explain could not follow the data, or found too little in them. */
enum sweep_outcome {
    SWEEP_RIGHT,
    SWEEP_TIED,
    SWEEP_WRONG,
    SWEEP_MISSED,
    SWEEP_UNKNOWN,
    SWEEP_FAILED
};

/* Of an explanation of a rig with this effect at this joint (1-based; 0: none); NULL: nothing was
 * hidden. */
enum sweep_outcome sweep_judge(const struct mk_explanation *e, const struct mk_effect_info *hidden,
                               int joint);

#ifdef __cplusplus
}
#endif
#endif

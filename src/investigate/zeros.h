/* Where the counters are zeroed: every run does it where the links hang, and that is not where the
 * model has them hang if anything pulls there. What the model lacks (a cable, an imbalance, an
 * encoder off its centre) shifts all readings by a constant that its law does not have, and is not
 * found under its name before the constant is known. So the zeros of the joints that hang are
 * fitted along with the base parameters, as `encoder-offset` effects of the model that logs are
 * explained from. */
#ifndef MECHKIT_INVESTIGATE_ZEROS_H
#define MECHKIT_INVESTIGATE_ZEROS_H

#include "mechkit/explain.h"

/* `given` with a zero of its own at each joint that hangs and has none yet; `spread`: another in
 * every log, for dry friction holds links off where they hang, and a counter is zeroed to a count.
 */
void zeros_free(const struct mk_model *given, bool spread, struct mk_model *out);

/* The same with the direction free in which a joint that turns level has its zero, a quarter turn
 * off to start from: an arm on a base that leans rests, and is zeroed, where it is lowest, and what
 * depends on its place has another phase than the law's. False: there is no such joint. */
bool zeros_turned(const struct mk_model *given, bool spread, struct mk_model *out);

/* Lets those zeros of a model differ from log to log by what a count is, at least. */
void zeros_vary(struct mk_model *model, const struct mk_model *given);

/* `model` without the zeros of hanging joints that `given` lacks, for planning: how well they are
 * known does not matter there. */
struct mk_model zeros_left_out(const struct mk_model *model, const struct mk_model *given);

/* Whether the zero that was fitted at a joint (0-based) is neither where the extended model rests
 * by itself nor where the plant does: then it is a finding. `offset` in the joint's unit. */
bool zeros_are_off(const struct mk_explanation *e, const struct mk_model *given, int joint,
                   double *offset);

#endif

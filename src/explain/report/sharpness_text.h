/* How sharply dry friction changes its sign, for people. */
#ifndef MECHKIT_EXPLAIN_REPORT_SHARPNESS_TEXT_H
#define MECHKIT_EXPLAIN_REPORT_SHARPNESS_TEXT_H

#include "mechkit/explain.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The sentence, "Dry friction changes its sign more sharply than ...", into text, cut where it is
 * longer than size; "" where the fits have the given sharpness. */
void mk_sharpness_sentence(const struct mk_explanation *e, char *text, size_t size);

#ifdef __cplusplus
}
#endif
#endif

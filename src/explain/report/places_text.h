/* Where counters were zeroed, for people. */
#ifndef MECHKIT_EXPLAIN_REPORT_PLACES_TEXT_H
#define MECHKIT_EXPLAIN_REPORT_PLACES_TEXT_H

#include "mechkit/explain.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The sentence without its full stop, "the counter of joint 1 was zeroed elsewhere in each log:
 * ...", into text, cut where it is longer than size; "" where places.joint is 0. */
void mk_places_sentence(const struct mk_explanation *e, char *text, size_t size);

#ifdef __cplusplus
}
#endif
#endif

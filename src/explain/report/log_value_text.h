/* Words for what differs from log to log. */
#ifndef MECHKIT_EXPLAIN_REPORT_LOG_VALUE_TEXT_H
#define MECHKIT_EXPLAIN_REPORT_LOG_VALUE_TEXT_H

#include "mechkit/explain.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A sentence on the errors of the logs' values of a cause where these are of how far the logs are
 * apart; "" where they are of the values themselves. */
const char *mk_apart_sentence(const struct mk_explanation *e, const struct mk_cause *c);

#ifdef __cplusplus
}
#endif
#endif

/* Which column drives a model, for people and for programs: written once for identify and explain.
 */
#ifndef MECHKIT_IDENT_INPUT_REPORT_H
#define MECHKIT_IDENT_INPUT_REPORT_H

#include "mechkit/ident.h"
#include "mechkit/json.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A sentence without its full stop, "the command, 9.1 +- 0.07 ms late, predicts ...", into text. */
void mk_input_sentence(const struct mk_input_comparison *input, char *text, size_t size);

/* What is taken: "the command, 9.1 +- 0.07 ms late", "the measured command". */
void mk_input_short(const struct mk_input_comparison *input, char *text, size_t size);

/* The JSON object `input` of both reports (docs/formats.md). NULL: no memory. */
cJSON *mk_input_json(const struct mk_input_comparison *input);

#ifdef __cplusplus
}
#endif
#endif

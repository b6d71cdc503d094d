/* What is left out of logs, as JSON: [{file, from_s, to_s, joint, why}]. */
#ifndef MECHKIT_IDENT_LEFT_OUT_JSON_H
#define MECHKIT_IDENT_LEFT_OUT_JSON_H

#include "mechkit/ident.h"
#include "mechkit/json.h"

#ifdef __cplusplus
extern "C" {
#endif

cJSON *left_out_json(const struct mk_left_out *all, int count);

#ifdef __cplusplus
}
#endif
#endif

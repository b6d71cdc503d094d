/* Data checks in reports (docs/formats.md). */
#ifndef MECHKIT_EXPERIMENT_DATA_CHECK_JSON_H
#define MECHKIT_EXPERIMENT_DATA_CHECK_JSON_H

#include "mechkit/data_check.h"
#include "mechkit/json.h"

#ifdef __cplusplus
extern "C" {
#endif

/* [{file, line, severity, what, do}]; line is null where it is all of the file. The caller owns it.
 */
cJSON *data_check_json(const struct mk_data_check *check);

#ifdef __cplusplus
}
#endif
#endif

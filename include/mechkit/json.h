/* Small helpers over cJSON for the reports that mechkit writes (--json, report.json).
 * Numbers are locale-proof and round-trip exact; NaN and infinities become null. */
#ifndef MECHKIT_JSON_H
#define MECHKIT_JSON_H

#include <cjson/cJSON.h>
#include <stddef.h>

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

/* A number item; null for NaN and infinities. The caller owns it (or the object it is added to). */
cJSON *mk_json_number(double value);
/* An array of `count` numbers. */
cJSON *mk_json_numbers(const double *values, size_t count);

/* Writes `root` as indented text with a final newline, atomically (temporary file and rename; a
 * device in place); path "-" means standard output. `root` stays the caller's. */
MK_NODISCARD enum mk_status mk_json_write(const char *path, const cJSON *root,
                                          struct mk_error *err);

/* Reads and parses a file; errors carry line and column. The caller frees with cJSON_Delete. */
MK_NODISCARD enum mk_status mk_json_read(const char *path, cJSON **out, struct mk_error *err);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif

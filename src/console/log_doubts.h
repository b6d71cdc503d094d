/* Logs that can hardly be what they are taken for: found out before a search or a fit takes its
 * time over them. */
#ifndef MECHKIT_CONSOLE_LOG_DOUBTS_H
#define MECHKIT_CONSOLE_LOG_DOUBTS_H

#include "mechkit/log.h"
#include "mechkit/model.h"

/* Reads logs; says on standard error where a last line is incomplete. Those read are the caller's
 * also on failure. */
MK_NODISCARD enum mk_status log_read_all(const char *const *paths, size_t count,
                                         struct mk_log **logs, struct mk_error *err);

/* Refuses what is certain, MK_ERR_EXPECT: angles that are wrapped, in degrees or in raw counts.
 * Says on standard error what is likely (other units, signs, swapped columns) and where the log's
 * metadata contradict the model or the times. A log that does not go with the model's rig at all is
 * left to who takes it. */
MK_NODISCARD enum mk_status log_doubts(const struct mk_log *const *logs, size_t count,
                                       const struct mk_model *model, struct mk_error *err);

/* Says on standard error where commands or angles are beyond anything that the rig has. */
void log_extremes(const struct mk_log *log, const struct mk_model *model);

#endif

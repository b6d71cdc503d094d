// Values of a log that no rig has.
#ifndef MECHKIT_IDENT_SIZES_HPP
#define MECHKIT_IDENT_SIZES_HPP

#include "mechkit/log.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

namespace mk
{

// MK_ERR_RANGE names file and line of the first reading of a joint (column x, q1 or q2), or of the
// first command, that is infinite or absurdly large.
enum mk_status check_angles(const double *x, const char *name, const mk_log &log, mk_error *err);
enum mk_status check_commands(const double *x, const char *name, const mk_model &model,
                              const mk_log &log, mk_error *err);

} // namespace mk
#endif

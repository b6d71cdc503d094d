// Logs without the rows that are not used.
#ifndef MECHKIT_IDENT_LEFT_OUT_HPP
#define MECHKIT_IDENT_LEFT_OUT_HPP

#include <vector>

#include "ident/owned_log.hpp"
#include "mechkit/ident.h"

namespace mk
{

// Puts copies, which `made` owns, in the place of those logs of which something is left out, and
// tells of it as mk_find_left_out() does.
enum mk_status leave_out(const mk_model &model, const mk_row_choice &choice,
                         std::vector<const mk_log *> &logs, std::vector<OwnedLog> &made,
                         mk_left_out *out, int *count, mk_error *err);

} // namespace mk
#endif

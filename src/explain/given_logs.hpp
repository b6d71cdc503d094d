// The logs as a caller of explain gives them: what is doubted of them, which are used, whether a
// motor acts in them.
#ifndef MECHKIT_EXPLAIN_GIVEN_LOGS_HPP
#define MECHKIT_EXPLAIN_GIVEN_LOGS_HPP

#include <cstddef>
#include <vector>

#include "mechkit/explain.h"

namespace mk
{

using LogList = std::vector<const mk_log *>;

struct LogSpan {
    const mk_log *const *logs;
    size_t count;
};

// All that is doubted of the logs, asked for where the options bring no check of their own.
// MK_ERR_EXPECT names what forbids to go on, unless it is forced.
enum mk_status check_data(const mk_model &model, const LogSpan &logs, const LogSpan &holdouts,
                          const mk_explain_options &options, mk_data_check &check, mk_error *err);

// Those that are not left out.
LogList used_logs(const mk_model &model, const LogSpan &given, enum mk_data_use use);

// Whether no command acts in any of the logs, so that they leave the scale of the model open. Of
// logs that cannot be read it is what the model says; they are told of later.
bool nothing_drives(const mk_model &model, const LogList &logs);

} // namespace mk
#endif

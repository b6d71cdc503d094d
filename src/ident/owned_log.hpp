// A log that frees itself.
#ifndef MECHKIT_IDENT_OWNED_LOG_HPP
#define MECHKIT_IDENT_OWNED_LOG_HPP

#include <memory>

#include "mechkit/log.h"

namespace mk
{

struct LogFree {
    void operator()(mk_log *log) const { mk_log_free(log); }
};
using OwnedLog = std::unique_ptr<mk_log, LogFree>;

// Rows [first, last) of a log, with its metadata and when it began. Throws std::bad_alloc.
OwnedLog rows_of_log(const mk_log &log, size_t first, size_t last);

} // namespace mk
#endif

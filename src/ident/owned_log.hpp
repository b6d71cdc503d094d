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

} // namespace mk
#endif

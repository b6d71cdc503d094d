// What every method of identification warns of.
#include <cstdarg>
#include <cstdio>

#include "ident/method.hpp"

namespace mk
{

void warn(mk_ident_result &r, const char *format, ...)
{
    if (r.warning_count == MK_MAX_FIT_WARNINGS)
        return;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(r.warning[r.warning_count++], sizeof r.warning[0], format, arguments);
    va_end(arguments);
}

void warn_if_not_excited(mk_ident_result &r, const mk_ident_parameter &p)
{
    if (!p.excited)
        warn(r, "the data say little about %s: excite it more or fix it", p.name);
}

} // namespace mk

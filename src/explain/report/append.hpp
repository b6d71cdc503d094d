// printf onto the end of a string: how the reports are written.
#ifndef MECHKIT_EXPLAIN_REPORT_APPEND_HPP
#define MECHKIT_EXPLAIN_REPORT_APPEND_HPP

#include <cstdarg>
#include <cstdio>
#include <string>

#include "mechkit/status.h"

namespace mk
{

// At most 1023 bytes at a time.
MK_PRINTF(2, 3) inline void add(std::string &s, const char *format, ...)
{
    char text[1024];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    s += text;
}

} // namespace mk
#endif

// The list of findings: fatal ones first, then doubts in the order in which they came.
#include "experiment/findings.hpp"

#include <algorithm>
#include <cstdarg>
#include <cstdio>

namespace mk
{

std::string text(const char *format, ...)
{
    char buf[400];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(buf, sizeof buf, format, arguments);
    va_end(arguments);
    return buf;
}

static void insert(mk_data_check &check, const mk_data_finding &f)
{
    mk_data_finding *end = check.finding + check.count;
    mk_data_finding *at = f.severity == MK_DATA_FATAL
                              ? std::find_if(check.finding, end,
                                             [](const mk_data_finding &other) {
                                                 return other.severity == MK_DATA_DOUBT;
                                             })
                              : end;
    if (at == check.finding + MK_MAX_DATA_FINDINGS)
        return;
    if (check.count < MK_MAX_DATA_FINDINGS)
        check.count++;
    else
        end--;
    std::move_backward(at, end, end + 1);
    *at = f;
}

void Findings::append(mk_data_check &check, const mk_data_check &more)
{
    std::for_each(more.finding, more.finding + more.count,
                  [&](const mk_data_finding &f) { insert(check, f); });
}

void Findings::add(enum mk_data_severity severity, const std::string &what,
                   const std::string &remedy, int line)
{
    mk_data_finding f = {};
    snprintf(f.file, sizeof f.file, "%s", log.path ? log.path : "");
    snprintf(f.what, sizeof f.what, "%s", what.c_str());
    snprintf(f.remedy, sizeof f.remedy, "%s", remedy.c_str());
    f.severity = severity;
    f.line = line;
    insert(check, f);
}

} // namespace mk

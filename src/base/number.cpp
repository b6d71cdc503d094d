#include "mechkit/number.h"

#include <charconv>
#include <cmath>
#include <cstring>

size_t mk_format_double(char buf[MK_NUMBER_MAX], double value)
{
    // Shortest text that reads back as the same double (Ryu); never depends on the locale.
    std::to_chars_result r = std::to_chars(buf, buf + MK_NUMBER_MAX - 1, value);
    if (std::isnan(value))
        r.ptr = buf + 3, memcpy(buf, "nan", 3); // without the sign that to_chars keeps
    *r.ptr = '\0';
    return static_cast<size_t>(r.ptr - buf);
}

static bool blank(char c)
{
    return c == ' ' || c == '\t' || c == '\r';
}

bool mk_parse_double(const char *begin, const char *end, double *value)
{
    while (begin < end && blank(*begin))
        begin++;
    while (end > begin && blank(end[-1]))
        end--;
    if (begin < end && *begin == '+' && begin + 1 < end && begin[1] != '-' && begin[1] != '+')
        begin++;
    double parsed = 0.0;
    std::from_chars_result r = std::from_chars(begin, end, parsed);
    if (r.ptr != end || begin == end)
        return false;
    if (r.ec == std::errc::result_out_of_range) {
        // from_chars tells neither overflow from underflow: a negative exponent means underflow.
        const char *e = begin;
        while (e < end && *e != 'e' && *e != 'E')
            e++;
        bool tiny = e + 1 < end ? e[1] == '-' : memchr(begin, '.', 3) != nullptr;
        parsed = std::copysign(tiny ? 0.0 : HUGE_VAL, *begin == '-' ? -1.0 : 1.0);
    } else if (r.ec != std::errc()) {
        return false;
    }
    *value = parsed;
    return true;
}

bool mk_parse_double_z(const char *text, double *value)
{
    return mk_parse_double(text, text + strlen(text), value);
}

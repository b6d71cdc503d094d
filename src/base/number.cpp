/* <charconv> is the one formatter in the standard libraries that gives the shortest exact text and
 * knows no locale. Numbers of usual size are written by a method that takes half the time
 * (base/shortest.hpp): they are what most of a log line costs. */
#include "mechkit/number.h"

#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "base/number_priv.h"
#include "base/shortest.hpp"

namespace shortest = mk::shortest;

namespace
{

static_assert(shortest::ROOM <= MK_FIELD_ROOM && shortest::MOST_TEXT < MK_NUMBER_MAX);

// Below this every whole number is a double of its own, so its digits are exact.
constexpr double whole_limit = 1e15;

bool is_blank(char c)
{
    return c == ' ' || c == '\t' || c == '\r';
}

bool is_digit(char c)
{
    return c >= '0' && c <= '9';
}

bool is_word(const char *begin, const char *end, const char *word)
{
    for (; begin < end && *word; begin++, word++)
        if ((*begin | 0x20) != *word)
            return false;
    return begin == end && !*word;
}

// What a number whose text is right but which no double can hold comes to: infinity when it is too
// large, 0 when too small. [at, end) has no sign.
double limit_of(const char *at, const char *end)
{
    const char *e = at;
    while (e < end && (*e | 0x20) != 'e')
        e++;
    const char *point = at;
    while (point < e && *point != '.')
        point++;
    const char *first = at; // first digit that counts
    while (first < e && (*first == '0' || *first == '.'))
        first++;
    // The decimal exponent of that digit, were there no "e" part.
    std::int64_t magnitude = first < point ? point - first - 1 : point - first;
    if (e < end) {
        std::int64_t exponent = 0;
        const char *from = e + 1 < end && e[1] == '+' ? e + 2 : e + 1;
        auto parsed = std::from_chars(from, end, exponent);
        if (parsed.ec == std::errc::result_out_of_range)
            exponent = *from == '-' ? -4000000000000 : 4000000000000;
        magnitude += exponent;
    }
    return magnitude > 0 ? std::numeric_limits<double>::infinity() : 0.0;
}

// An unsigned number or word that fills [at, end).
bool parse_magnitude(const char *at, const char *end, double *out)
{
    if (at == end)
        return false;
    if (!is_digit(*at) && *at != '.') {
        bool nan = is_word(at, end, "nan");
        if (!nan && !is_word(at, end, "inf") && !is_word(at, end, "infinity"))
            return false;
        *out = nan ? std::numeric_limits<double>::quiet_NaN()
                   : std::numeric_limits<double>::infinity();
        return true;
    }
    auto parsed = std::from_chars(at, end, *out);
    if (parsed.ptr != end)
        return false;
    if (parsed.ec == std::errc::result_out_of_range)
        *out = limit_of(at, end);
    return parsed.ec == std::errc() || parsed.ec == std::errc::result_out_of_range;
}

// Writes MK_NUMBER_MAX - 1 bytes at most, of MK_FIELD_ROOM, and no NUL; returns the end.
inline char *format(char *buf, double value)
{
    if (std::fabs(value) < whole_limit) {
        auto whole = static_cast<std::int64_t>(value);
        if (static_cast<double>(whole) != value && shortest::takes(value))
            return shortest::write(buf, value);
        if (static_cast<double>(whole) == value && (whole != 0 || !std::signbit(value)))
            return std::to_chars(buf, buf + MK_NUMBER_MAX - 1, whole).ptr;
    } else if (std::isnan(value)) {
        std::memcpy(buf, "nan", 3); // to_chars would keep its sign
        return buf + 3;
    }
    return std::to_chars(buf, buf + MK_NUMBER_MAX - 1, value).ptr;
}

} // namespace

extern "C" size_t mk_format_double(char buf[MK_NUMBER_MAX], double value)
{
    char text[MK_FIELD_ROOM];
    const auto length = static_cast<size_t>(format(text, value) - text);
    std::memcpy(buf, text, length);
    buf[length] = '\0';
    return length;
}

extern "C" char *mk_format_field(char *at, double value, char separator)
{
    char *end = std::isnan(value) ? at : format(at, value);
    *end = separator;
    return end + 1;
}

extern "C" bool mk_parse_double(const char *begin, const char *end, double *value)
{
    while (begin < end && is_blank(*begin))
        begin++;
    while (end > begin && is_blank(end[-1]))
        end--;
    bool negative = begin < end && *begin == '-';
    if (begin < end && (*begin == '-' || *begin == '+'))
        begin++;
    double magnitude;
    if (!parse_magnitude(begin, end, &magnitude))
        return false;
    *value = negative ? -magnitude : magnitude;
    return true;
}

extern "C" bool mk_parse_double_z(const char *text, double *value)
{
    return mk_parse_double(text, text + std::strlen(text), value);
}

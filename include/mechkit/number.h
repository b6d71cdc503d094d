/* Numbers as text, whatever the locale. A double written by mk_format_double and read by
 * mk_parse_double is the same double, bit for bit (NaN: some NaN). Re-entrant; no allocation. */
#ifndef MECHKIT_NUMBER_H
#define MECHKIT_NUMBER_H

#include <stdbool.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define MK_NUMBER_MAX 32 /* bytes that any double needs as text, with the terminating NUL */

/* Shortest decimal text that reads back as `value` ("nan", "inf", "-inf" for the others; -0.0 is
 * "-0"). Whole numbers below 1e15 are written without an exponent: counts stay counts. Writes at
 * most MK_NUMBER_MAX bytes to buf, NUL included; returns the length without the NUL. */
size_t mk_format_double(char buf[MK_NUMBER_MAX], double value);

/* Reads a decimal or exponent number (also "nan", "inf", with optional sign and '+') that fills
 * [begin, end) exactly but for blanks (and a CR) at either side. What is too large for a double is
 * an infinity, what is too small a zero. False: not a number; *value is untouched. */
bool mk_parse_double(const char *begin, const char *end, double *value);

/* As mk_parse_double for a NUL-terminated text. */
bool mk_parse_double_z(const char *text, double *value);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif

/* Numbers as fields of a log line. Not for other folders. */
#ifndef MECHKIT_BASE_NUMBER_PRIV_H
#define MECHKIT_BASE_NUMBER_PRIV_H

#ifdef __cplusplus
extern "C" {
#endif

/* Number and separator, no NUL; NaN is empty. `at` has MK_NUMBER_MAX bytes of room; returns the
 * end. */
char *mk_format_field(char *at, double value, char separator);

#ifdef __cplusplus
}
#endif
#endif

/* Numbers as fields of a log line. Not for other folders. */
#ifndef MECHKIT_BASE_NUMBER_PRIV_H
#define MECHKIT_BASE_NUMBER_PRIV_H

#ifdef __cplusplus
extern "C" {
#endif

/* Bytes that mk_format_field needs: what is behind the end that it returns is written to as well.
 */
#define MK_FIELD_ROOM 48

/* Number and separator, MK_NUMBER_MAX bytes at most and no NUL; NaN is empty. `at` has
 * MK_FIELD_ROOM bytes of room; returns the end. */
char *mk_format_field(char *at, double value, char separator);

#ifdef __cplusplus
}
#endif
#endif

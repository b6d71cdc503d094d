/* When and where something was made, for files that are kept. */
#ifndef MECHKIT_BASE_ORIGIN_H
#define MECHKIT_BASE_ORIGIN_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

#define MK_DATE_TEXT 32 /* bytes that mk_date_text needs */

/* "2026-11-24T03:10:47Z", now, in UTC; where SOURCE_DATE_EPOCH says a time (seconds since 1970),
 * that one, so that what is made again is the same. Returns buf. */
const char *mk_date_text(char buf[MK_DATE_TEXT]);

/* The words of a command line with blanks between, such as a shell would read them: quoted where
 * it takes quotes. Cut to `size` bytes. Returns buf. */
const char *mk_command_text(char *buf, size_t size, int argc, const char *const *argv);

#ifdef __cplusplus
}
#endif
#endif

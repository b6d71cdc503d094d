/* Text that comes from outside, as it may be shown. */
#ifndef MECHKIT_BASE_TEXT_H
#define MECHKIT_BASE_TEXT_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What a terminal would take for a command, or what is no UTF-8, is written \x1b. As much of the
 * text as fits, whole characters only. Returns `out`. */
char *mk_show_text(char *out, size_t size, const char *text);

#ifdef __cplusplus
}
#endif
#endif

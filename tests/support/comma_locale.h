/* A locale whose decimal point is a comma. */
#ifndef MECHKIT_TESTS_SUPPORT_COMMA_LOCALE_H
#define MECHKIT_TESTS_SUPPORT_COMMA_LOCALE_H

#include <stdbool.h>

/* Switches the process to such a locale: an installed one, or one made for the occasion. False,
 * with a line on stderr, where neither is to be had. */
bool use_comma_locale(void);

#endif

#include "support/comma_locale.h"

#include <locale.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support/files.h"

static bool has_comma(void)
{
    return strcmp(localeconv()->decimal_point, ",") == 0;
}

/* localedef makes a locale of three lines; its warnings about what is left out end in status 1. */
static bool made_locale(void)
{
    const char *source = scratch_text("comma.src", "LC_NUMERIC\ndecimal_point \",\"\n"
                                                   "thousands_sep \".\"\ngrouping 3;3\n"
                                                   "END LC_NUMERIC\n");
    const char *target = scratch("comma");
    char command[1024], directory[256];
    snprintf(command, sizeof command, "localedef -c --no-archive -i %s %s >/dev/null 2>&1", source,
             target);
    snprintf(directory, sizeof directory, "%.*s", (int)(strrchr(target, '/') - target), target);
    if (system(command) == -1)
        return false;
    setenv("LOCPATH", directory, 1);
    return setlocale(LC_NUMERIC, "comma") && has_comma();
}

bool use_comma_locale(void)
{
    static const char *const names[] = {"de_DE.UTF-8", "de_DE", "fr_FR.UTF-8", "nl_NL.UTF-8"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (setlocale(LC_ALL, names[i]) && has_comma())
            return true;
    if (made_locale())
        return true;
    fprintf(stderr, "skipped: no locale with a decimal comma is installed and none can be made\n");
    return false;
}

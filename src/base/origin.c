#include "base/origin.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* 31 December 9999, the last day whose date has four digits of a year. */
#define LAST_SECOND 253402300799LL

/* Seconds since 1970 that the environment asks for; -1: none that can be. */
static long long asked_for(void)
{
    const char *text = getenv("SOURCE_DATE_EPOCH");
    char *end;
    if (!text || *text < '0' || *text > '9')
        return -1;
    errno = 0;
    long long seconds = strtoll(text, &end, 10);
    return errno == 0 && *end == '\0' && seconds <= LAST_SECOND ? seconds : -1;
}

const char *mk_date_text(char buf[MK_DATE_TEXT])
{
    const long long asked = asked_for();
    const time_t when = asked >= 0 ? (time_t)asked : time(NULL);
    struct tm utc;
    gmtime_r(&when, &utc);
    strftime(buf, MK_DATE_TEXT, "%Y-%m-%dT%H:%M:%SZ", &utc);
    return buf;
}

static void put(char *buf, size_t size, size_t *used, char c)
{
    if (*used + 1 < size)
        buf[(*used)++] = c;
}

static void put_word(char *buf, size_t size, size_t *used, const char *word)
{
    static const char plain[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789"
                                "_-+=.,:/@%";
    const char *quote = *word && strspn(word, plain) == strlen(word) ? "" : "'";
    if (*quote)
        put(buf, size, used, '\'');
    for (; *word; word++) {
        if (*word != '\'') {
            put(buf, size, used, *word);
            continue;
        }
        for (const char *at = "'\\''"; *at; at++)
            put(buf, size, used, *at);
    }
    if (*quote)
        put(buf, size, used, '\'');
}

const char *mk_command_text(char *buf, size_t size, int argc, const char *const *argv)
{
    size_t used = 0;
    for (int i = 0; i < argc; i++) {
        if (i)
            put(buf, size, &used, ' ');
        put_word(buf, size, &used, argv[i]);
    }
    buf[used] = '\0';
    return buf;
}

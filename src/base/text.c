#include "base/text.h"

#include <stdio.h>
#include <string.h>

/* Bytes of the character at `s`, if it is one that may be shown; else 0. */
static size_t plain_character(const unsigned char *s)
{
    if (s[0] < 0x80)
        return s[0] >= ' ' && s[0] != 0x7f;
    if (s[0] < 0xc2 || s[0] > 0xf4 || (s[0] == 0xc2 && s[1] < 0xa0)) /* U+0080 .. 9F steer, too */
        return 0;
    size_t n = s[0] < 0xe0 ? 2 : s[0] < 0xf0 ? 3 : 4;
    for (size_t i = 1; i < n; i++)
        if ((s[i] & 0xc0) != 0x80)
            return 0;
    return n;
}

size_t mk_byte_order_mark(const char *text, size_t length)
{
    static const char mark[] = "\xef\xbb\xbf";
    const size_t size = sizeof mark - 1;
    return length >= size && memcmp(text, mark, size) == 0 ? size : 0;
}

char *mk_show_text(char *out, size_t size, const char *text)
{
    const unsigned char *s = (const unsigned char *)text;
    size_t used = 0;
    while (*s) {
        size_t n = plain_character(s);
        if (used + (n ? n : 4) >= size)
            break;
        if (n)
            memcpy(out + used, s, n);
        else
            snprintf(out + used, size - used, "\\x%02x", *s);
        used += n ? n : 4;
        s += n ? n : 1;
    }
    out[used] = '\0';
    return out;
}

/* --- what may have been meant ---------------------------------------------------------------- */

/* From so many letters on it is something else. */
#define FAR_AWAY 3
/* Shorter words are near to anything. */
#define WORD_LEAST 3

/* How many letters must be put in, left out or changed to make one word of the other; long words
 * are far away. */
static int distance(const char *a, const char *b)
{
    enum { MOST = 31 };
    int row[MOST + 1];
    size_t n = strlen(a), m = strlen(b);
    if (n > MOST || m > MOST)
        return MOST;
    for (size_t j = 0; j <= m; j++)
        row[j] = (int)j;
    for (size_t i = 1; i <= n; i++) {
        int corner = row[0];
        row[0] = (int)i;
        for (size_t j = 1; j <= m; j++) {
            int changed = corner + (a[i - 1] != b[j - 1]), above = row[j];
            int moved = 1 + (above < row[j - 1] ? above : row[j - 1]);
            corner = above;
            row[j] = changed < moved ? changed : moved;
        }
    }
    return row[m];
}

void mk_meant_try(struct mk_meant *meant, const char *name)
{
    int d = distance(meant->word, name), least = meant->name ? meant->distance : FAR_AWAY;
    size_t length = strlen(meant->word);
    if (d >= least || length < WORD_LEAST || 2 * (size_t)d > length)
        return;
    meant->name = name;
    meant->distance = d;
}

const char *mk_meant_text(const struct mk_meant *meant, char *buf, size_t size)
{
    buf[0] = '\0';
    if (meant->name)
        snprintf(buf, size, ": did you mean %s?", meant->name);
    return buf;
}

const char *mk_comma_text(const char *number, char *buf, size_t size)
{
    const char *sign = number + strspn(number, "+-");
    size_t whole = strspn(sign, "0123456789"), part = 0;
    const char *comma = sign + whole;
    buf[0] = '\0';
    if (*comma == ',')
        part = strspn(comma + 1, "0123456789");
    if (part > 0 && !comma[1 + part])
        snprintf(buf, size, "; decimals come after a point: %.*s.%s", (int)(comma - number), number,
                 comma + 1);
    return buf;
}

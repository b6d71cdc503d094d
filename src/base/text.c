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

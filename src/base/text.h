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

/* How many bytes of a text of `length` are the byte order mark that some editors put before the
 * first line of UTF-8: 3 or 0. */
size_t mk_byte_order_mark(const char *text, size_t length);

/* The name that a word which is not understood is nearest to: at most two letters, and half of the
 * word's, are put in, left out or changed. Start with `word` alone set. */
struct mk_meant {
    const char *word;
    const char *name; /* NULL: none is near */
    int distance;
};
void mk_meant_try(struct mk_meant *meant, const char *name);
/* ": did you mean NAME?", "" where none is near. Returns buf. */
const char *mk_meant_text(const struct mk_meant *meant, char *buf, size_t size);

/* "; decimals come after a point: 0.054" of "0,054"; "" of other text. Returns buf. */
const char *mk_comma_text(const char *number, char *buf, size_t size);

#ifdef __cplusplus
}
#endif
#endif

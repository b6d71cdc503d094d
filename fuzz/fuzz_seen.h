/* Eyes for code that is not built for the fuzzer: what a library made of the bytes counts as new
 * ground where it is new. */
#ifndef MECHKIT_FUZZ_SEEN_H
#define MECHKIT_FUZZ_SEEN_H

#include <stddef.h>
#include <stdint.h>

/* A number that says what was seen, of few that there can be: sizes as fuzz_size(). */
void fuzz_seen(uint32_t what);
/* A text as a number. */
uint32_t fuzz_text(const char *text);
/* How many bits a size has: 0 for 0, then 1, 2, 3 ... */
uint32_t fuzz_size(size_t size);

#endif

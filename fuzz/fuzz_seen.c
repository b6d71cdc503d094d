#include "fuzz_seen.h"

#define PLACES (1u << 14)

__attribute__((used, section("__libfuzzer_extra_counters"))) static uint8_t place[PLACES];

/* Spread over the places: neighbours in what there is to see do not share one. */
void fuzz_seen(uint32_t what)
{
    what = (what ^ what >> 16) * 0x45d9f3bu;
    what = (what ^ what >> 16) * 0x45d9f3bu;
    place[(what ^ what >> 16) % PLACES] = 1;
}

uint32_t fuzz_text(const char *text)
{
    uint32_t h = 2166136261u;
    for (; *text; text++)
        h = (h ^ (uint8_t)*text) * 16777619u;
    return h;
}

uint32_t fuzz_size(size_t size)
{
    uint32_t bits = 0;
    for (; size; size >>= 1)
        bits++;
    return bits;
}

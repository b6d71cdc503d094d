/* What a board says that says anything: the bytes of a fuzzer as the other end of a link. */
#ifndef MECHKIT_FUZZ_WIRE_TALK_H
#define MECHKIT_FUZZ_WIRE_TALK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "driver/frame.h"

enum talk_event { TALK_BYTES, TALK_SILENCE, TALK_GARBLED, TALK_GONE };

/* A new conversation. */
void talk_begin(const uint8_t *data, size_t size);
/* The next byte; 0 when there are no more. */
uint8_t talk_byte(void);
bool talk_ended(void);
/* The host has sent bytes. */
void talk_heard(const uint8_t *bytes, size_t n);
/* What comes next, at most `room` bytes of it. */
enum talk_event talk_say(uint8_t *out, size_t room, size_t *n);

/* The clock that host code looks at instead of the machine's: every look takes some time. */
int64_t talk_now_ns(void);
void talk_pass(int64_t ns);

#endif

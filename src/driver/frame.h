/* Frames of the wire protocol (docs/protocol.md): how a message is delimited and checked.
 *
 *     'M' 'K'  version  type  sequence(4)  length(2)  crc16(2)  payload(length)  crc32(4)
 *
 * Numbers are little-endian. The header has a check of its own, so that a length is believed only
 * when it arrived whole: after garbage the decoder finds the next frame without having to wait for
 * bytes that a broken length promised.
 *
 * Portable C for both ends: no heap, no operating system, no floating point. RT.
 */
#ifndef MECHKIT_DRIVER_FRAME_H
#define MECHKIT_DRIVER_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define MK_FRAME_VERSION 1
#define MK_FRAME_HEADER 12
#define MK_FRAME_TRAILER 4
#define MK_FRAME_PAYLOAD_MAX 240
#define MK_FRAME_MAX (MK_FRAME_HEADER + MK_FRAME_PAYLOAD_MAX + MK_FRAME_TRAILER)

struct mk_frame {
    uint8_t version;
    uint8_t type;
    uint16_t length; /* of the payload */
    uint32_t sequence;
    const uint8_t *payload; /* borrowed: until the decoder is called again */
};

/* CRC-16/IBM-3740 (0x29b1 for "123456789") and CRC-32/ISO-HDLC (0xcbf43926). */
uint16_t mk_crc16(const uint8_t *bytes, size_t n);
uint32_t mk_crc32(const uint8_t *bytes, size_t n);

/* Writes the whole frame; payload may be NULL when its length is 0. Returns the number of bytes, 0
 * when the payload is too long. `frame->version` is taken as it is. */
size_t mk_frame_encode(const struct mk_frame *frame, uint8_t out[MK_FRAME_MAX]);

/* Reads frames out of a stream of bytes cut into pieces anywhere. */
struct mk_decoder {
    uint8_t buffer[MK_FRAME_MAX];
    size_t used;      /* bytes in the buffer */
    size_t consumed;  /* of these, the frame that was given out last */
    uint32_t frames;  /* good ones */
    uint32_t broken;  /* began well and failed a check */
    uint32_t skipped; /* bytes that belonged to no frame */
};
void mk_decoder_reset(struct mk_decoder *d);
/* Takes bytes from *bytes (advancing it and *n) until a frame is complete: true. False: all bytes
 * are taken. Call until false. */
bool mk_decoder_next(struct mk_decoder *d, const uint8_t **bytes, size_t *n, struct mk_frame *out);

/* --- little-endian numbers ------------------------------------------------------------------ */

static inline void mk_put16(uint8_t *p, uint16_t v)
{
    p[0] = (uint8_t)v;
    p[1] = (uint8_t)(v >> 8);
}
static inline void mk_put32(uint8_t *p, uint32_t v)
{
    mk_put16(p, (uint16_t)v);
    mk_put16(p + 2, (uint16_t)(v >> 16));
}
static inline void mk_put64(uint8_t *p, uint64_t v)
{
    mk_put32(p, (uint32_t)v);
    mk_put32(p + 4, (uint32_t)(v >> 32));
}
static inline uint16_t mk_get16(const uint8_t *p)
{
    return (uint16_t)(p[0] | p[1] << 8);
}
static inline uint32_t mk_get32(const uint8_t *p)
{
    return mk_get16(p) | (uint32_t)mk_get16(p + 2) << 16;
}
static inline uint64_t mk_get64(const uint8_t *p)
{
    return mk_get32(p) | (uint64_t)mk_get32(p + 4) << 32;
}

#endif

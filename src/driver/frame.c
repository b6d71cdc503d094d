#include "driver/frame.h"

#include <string.h>

#define SYNC_0 0x4d /* 'M' */
#define SYNC_1 0x4b /* 'K' */

/* Half a byte at a time: tables small enough for a microcontroller. */
uint16_t mk_crc16(const uint8_t *bytes, size_t n)
{
    static const uint16_t table[16] = {0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50a5,
                                       0x60c6, 0x70e7, 0x8108, 0x9129, 0xa14a, 0xb16b,
                                       0xc18c, 0xd1ad, 0xe1ce, 0xf1ef};
    unsigned crc = 0xffff;
    for (size_t i = 0; i < n; i++) {
        crc = ((crc << 4) ^ table[(crc >> 12 ^ bytes[i] >> 4) & 15]) & 0xffff;
        crc = ((crc << 4) ^ table[(crc >> 12 ^ bytes[i]) & 15]) & 0xffff;
    }
    return (uint16_t)crc;
}

uint32_t mk_crc32(const uint8_t *bytes, size_t n)
{
    static const uint32_t table[16] = {0x00000000, 0x1db71064, 0x3b6e20c8, 0x26d930ac,
                                       0x76dc4190, 0x6b6b51f4, 0x4db26158, 0x5005713c,
                                       0xedb88320, 0xf00f9344, 0xd6d6a3e8, 0xcb61b38c,
                                       0x9b64c2b0, 0x86d3d2d4, 0xa00ae278, 0xbdbdf21c};
    uint32_t crc = 0xffffffff;
    for (size_t i = 0; i < n; i++) {
        crc = crc >> 4 ^ table[(crc ^ bytes[i]) & 15];
        crc = crc >> 4 ^ table[(crc ^ bytes[i] >> 4) & 15];
    }
    return ~crc;
}

size_t mk_frame_encode(const struct mk_frame *frame, uint8_t out[MK_FRAME_MAX])
{
    if (frame->length > MK_FRAME_PAYLOAD_MAX)
        return 0;
    out[0] = SYNC_0;
    out[1] = SYNC_1;
    out[2] = frame->version;
    out[3] = frame->type;
    mk_put32(out + 4, frame->sequence);
    mk_put16(out + 8, frame->length);
    mk_put16(out + 10, mk_crc16(out, 10));
    if (frame->length > 0)
        memcpy(out + MK_FRAME_HEADER, frame->payload, frame->length);
    size_t checked = MK_FRAME_HEADER + (size_t)frame->length;
    mk_put32(out + checked, mk_crc32(out, checked));
    return checked + MK_FRAME_TRAILER;
}

void mk_decoder_reset(struct mk_decoder *d)
{
    memset(d, 0, sizeof *d);
}

static void discard(struct mk_decoder *d, size_t n)
{
    memmove(d->buffer, d->buffer + n, d->used - n);
    d->used -= n;
}

/* Drops bytes until the buffer begins like a frame, or is empty. */
static void find_sync(struct mk_decoder *d)
{
    size_t at = 0;
    while (at < d->used &&
           (d->buffer[at] != SYNC_0 || (at + 1 < d->used && d->buffer[at + 1] != SYNC_1)))
        at++;
    d->skipped += (uint32_t)at;
    discard(d, at);
}

/* What the buffer begins with is no frame: look for one from the next byte on. */
static void reject(struct mk_decoder *d)
{
    d->broken++;
    d->skipped++;
    discard(d, 1);
}

/* Looks at the buffer: the frame's size when it is complete and good, else 0 and in *missing how
 * many bytes to wait for. */
static size_t examine(struct mk_decoder *d, size_t *missing)
{
    for (;;) {
        find_sync(d);
        if (d->used < MK_FRAME_HEADER) {
            *missing = MK_FRAME_HEADER - d->used;
            return 0;
        }
        size_t length = mk_get16(d->buffer + 8);
        if (mk_get16(d->buffer + 10) != mk_crc16(d->buffer, 10) || length > MK_FRAME_PAYLOAD_MAX) {
            reject(d);
            continue;
        }
        size_t checked = MK_FRAME_HEADER + length, size = checked + MK_FRAME_TRAILER;
        if (d->used < size) {
            *missing = size - d->used;
            return 0;
        }
        if (mk_get32(d->buffer + checked) == mk_crc32(d->buffer, checked))
            return size;
        reject(d);
    }
}

bool mk_decoder_next(struct mk_decoder *d, const uint8_t **bytes, size_t *n, struct mk_frame *out)
{
    discard(d, d->consumed);
    d->consumed = 0;
    for (;;) {
        size_t missing = 0, size = examine(d, &missing);
        if (size > 0) {
            d->frames++;
            d->consumed = size;
            *out = (struct mk_frame){.version = d->buffer[2],
                                     .type = d->buffer[3],
                                     .sequence = mk_get32(d->buffer + 4),
                                     .length = mk_get16(d->buffer + 8),
                                     .payload = d->buffer + MK_FRAME_HEADER};
            return true;
        }
        if (*n == 0)
            return false;
        size_t take = missing < *n ? missing : *n;
        memcpy(d->buffer + d->used, *bytes, take);
        d->used += take;
        *bytes += take;
        *n -= take;
    }
}

/* libFuzzer: the frame decoder. The input is a stream of bytes, cut where its own bytes say.
 * Whatever comes out as a frame must be one: encoded again, it is in the input. */
#include <stdlib.h>
#include <string.h>

#include "driver/frame.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static int contains(const uint8_t *data, size_t size, const uint8_t *part, size_t n)
{
    for (size_t i = 0; i + n <= size; i++)
        if (memcmp(data + i, part, n) == 0)
            return 1;
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct mk_decoder d;
    struct mk_frame f;
    uint8_t again[MK_FRAME_MAX];
    size_t taken = 0, given = 0;
    mk_decoder_reset(&d);
    while (taken < size) {
        size_t n = 1 + data[taken] % 97;
        n = n < size - taken ? n : size - taken;
        const uint8_t *p = data + taken;
        taken += n;
        while (mk_decoder_next(&d, &p, &n, &f)) {
            size_t length = mk_frame_encode(&f, again);
            given += length;
            if (length == 0 || !contains(data, size, again, length))
                abort();
        }
        if (n != 0 || d.used >= MK_FRAME_MAX)
            abort();
    }
    /* Every byte is part of a frame, skipped, or still waited with. */
    if (given + d.skipped + d.used - d.consumed != size)
        abort();
    return 0;
}

#include "mechkit/ring.h"

#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define CACHE_LINE 64

/* Each side has its own cache line: its index, which the other side reads, and a copy of the
 * other's index, which saves looking at the other's line while there is room. */
struct side {
    _Alignas(CACHE_LINE) atomic_size_t index;
    size_t other;
};

struct mk_ring {
    struct side writer, reader;
    _Alignas(CACHE_LINE) size_t mask;
    size_t record_size;
    unsigned char *records;
};

enum mk_status mk_ring_create(size_t capacity, size_t record_size, struct mk_ring **out)
{
    *out = NULL;
    if (capacity == 0 || record_size == 0 || capacity > SIZE_MAX / 4 / record_size)
        return MK_ERR_INVALID;
    size_t n = 1;
    while (n < capacity)
        n *= 2;
    struct mk_ring *ring = aligned_alloc(CACHE_LINE, sizeof *ring);
    if (!ring)
        return MK_ERR_NOMEM;
    memset(ring, 0, sizeof *ring);
    ring->mask = n - 1;
    ring->record_size = record_size;
    ring->records = malloc(n * record_size);
    if (!ring->records) {
        free(ring);
        return MK_ERR_NOMEM;
    }
    /* Touched now, so that the first lap of a real-time writer meets no page fault. */
    memset(ring->records, 0, n * record_size);
    atomic_init(&ring->writer.index, 0);
    atomic_init(&ring->reader.index, 0);
    *out = ring;
    return MK_OK;
}

void mk_ring_destroy(struct mk_ring *ring)
{
    if (!ring)
        return;
    free(ring->records);
    free(ring);
}

static unsigned char *slot(const struct mk_ring *ring, size_t index)
{
    return ring->records + (index & ring->mask) * ring->record_size;
}

bool mk_ring_push(struct mk_ring *ring, const void *record)
{
    size_t w = atomic_load_explicit(&ring->writer.index, memory_order_relaxed);
    if (w - ring->writer.other > ring->mask) {
        ring->writer.other = atomic_load_explicit(&ring->reader.index, memory_order_acquire);
        if (w - ring->writer.other > ring->mask)
            return false;
    }
    memcpy(slot(ring, w), record, ring->record_size);
    atomic_store_explicit(&ring->writer.index, w + 1, memory_order_release);
    return true;
}

bool mk_ring_pop(struct mk_ring *ring, void *record)
{
    size_t r = atomic_load_explicit(&ring->reader.index, memory_order_relaxed);
    if (r == ring->reader.other) {
        ring->reader.other = atomic_load_explicit(&ring->writer.index, memory_order_acquire);
        if (r == ring->reader.other)
            return false;
    }
    memcpy(record, slot(ring, r), ring->record_size);
    atomic_store_explicit(&ring->reader.index, r + 1, memory_order_release);
    return true;
}

size_t mk_ring_count(const struct mk_ring *ring)
{
    /* The reader's index first: it never passes a writer's index that is loaded after it. A third
     * thread may see both move in between. */
    size_t r = atomic_load_explicit(&ring->reader.index, memory_order_acquire);
    size_t count = atomic_load_explicit(&ring->writer.index, memory_order_acquire) - r;
    return count <= ring->mask ? count : ring->mask + 1;
}

size_t mk_ring_capacity(const struct mk_ring *ring)
{
    return ring->mask + 1;
}

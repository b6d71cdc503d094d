/* A lock-free ring of fixed-size records: one thread writes, one thread reads.
 *
 * RT-safe after creation: push and pop copy one record and touch two atomics; they never block,
 * allocate or fail but for "full" and "empty". More than one writer or reader is a programming
 * error. Capacity is rounded up to a power of two.
 */
#ifndef MECHKIT_RING_H
#define MECHKIT_RING_H

#include <stdbool.h>
#include <stddef.h>

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

struct mk_ring;

/* A ring for at least `capacity` records of `record_size` bytes each (both > 0). MK_ERR_INVALID,
 * MK_ERR_NOMEM. *out is NULL on failure. */
MK_NODISCARD enum mk_status mk_ring_create(size_t capacity, size_t record_size,
                                           struct mk_ring **out);
void mk_ring_destroy(struct mk_ring *ring); /* NULL allowed */

bool mk_ring_push(struct mk_ring *ring, const void *record); /* RT; writer only; false: full */
bool mk_ring_pop(struct mk_ring *ring, void *record);        /* RT; reader only; false: empty */

size_t mk_ring_count(const struct mk_ring *ring);    /* RT; a snapshot, exact for either side */
size_t mk_ring_capacity(const struct mk_ring *ring); /* RT */

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif

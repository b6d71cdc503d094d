/* Figures of a run: the histogram of lateness and the wait-free snapshot. */
#include <string.h>

#include "ctrl/loop_priv.h"

#define SUB_COUNT (1u << MK_HISTOGRAM_SUB_BITS)
#define FRESH 4u

void mk_histogram_clear(struct mk_histogram *h)
{
    for (int i = 0; i < MK_HISTOGRAM_BINS; i++)
        atomic_store_explicit(&h->bin[i], 0, memory_order_relaxed);
    atomic_store_explicit(&h->max_ns, 0, memory_order_relaxed);
    atomic_store_explicit(&h->sum_ns, 0, memory_order_relaxed);
    atomic_store_explicit(&h->count, 0, memory_order_relaxed);
}

/* Values below SUB_COUNT have a bin each; above, the leading bits after the first choose. */
static unsigned bin_of(uint64_t ns)
{
    if (ns < SUB_COUNT)
        return (unsigned)ns;
    unsigned octave = 63u - (unsigned)__builtin_clzll(ns) - MK_HISTOGRAM_SUB_BITS;
    unsigned index = (octave << MK_HISTOGRAM_SUB_BITS) + (unsigned)(ns >> octave);
    return index < MK_HISTOGRAM_BINS ? index : MK_HISTOGRAM_BINS - 1;
}

static double upper_edge_ns(unsigned index)
{
    if (index < SUB_COUNT)
        return index;
    unsigned octave = (index >> MK_HISTOGRAM_SUB_BITS) - 1;
    uint64_t base = index - (octave << MK_HISTOGRAM_SUB_BITS);
    return (double)(((base + 1) << octave) - 1);
}

/* The only writer adds without a locked instruction. */
static void add(atomic_ullong *to, unsigned long long n)
{
    atomic_store_explicit(to, atomic_load_explicit(to, memory_order_relaxed) + n,
                          memory_order_relaxed);
}

void mk_histogram_add(struct mk_histogram *h, int64_t ns)
{
    uint64_t value = ns > 0 ? (uint64_t)ns : 0;
    atomic_uint *bin = &h->bin[bin_of(value)];
    atomic_store_explicit(bin, atomic_load_explicit(bin, memory_order_relaxed) + 1,
                          memory_order_relaxed);
    if (value > atomic_load_explicit(&h->max_ns, memory_order_relaxed))
        atomic_store_explicit(&h->max_ns, value, memory_order_relaxed);
    add(&h->sum_ns, value);
    add(&h->count, 1);
}

double mk_histogram_max_us(const struct mk_histogram *h)
{
    return (double)atomic_load_explicit(&h->max_ns, memory_order_relaxed) * 1e-3;
}

double mk_histogram_mean_us(const struct mk_histogram *h)
{
    uint64_t n = atomic_load_explicit(&h->count, memory_order_relaxed);
    return n ? (double)atomic_load_explicit(&h->sum_ns, memory_order_relaxed) * 1e-3 / (double)n
             : 0.0;
}

double mk_histogram_percentile_us(const struct mk_histogram *h, double p)
{
    uint64_t total = 0, seen = 0;
    for (int i = 0; i < MK_HISTOGRAM_BINS; i++)
        total += atomic_load_explicit(&h->bin[i], memory_order_relaxed);
    double max_us = mk_histogram_max_us(h);
    for (unsigned i = 0; i < MK_HISTOGRAM_BINS && total > 0; i++) {
        seen += atomic_load_explicit(&h->bin[i], memory_order_relaxed);
        if ((double)seen >= p * (double)total) {
            double edge_us = upper_edge_ns(i) * 1e-3;
            return edge_us < max_us ? edge_us : max_us;
        }
    }
    return max_us;
}

void mk_publish_init(struct mk_publish *p)
{
    memset(p->slot, 0, sizeof p->slot);
    p->front = 0;
    p->back = 1;
    atomic_init(&p->middle, 2);
}

void mk_publish_put(struct mk_publish *p, const struct mk_loop_snapshot *value)
{
    p->slot[p->back] = *value;
    /* Release what was written, acquire the slot that the reader may have given back. */
    p->back = atomic_exchange_explicit(&p->middle, p->back | FRESH, memory_order_acq_rel) & 3u;
}

const struct mk_loop_snapshot *mk_publish_get(struct mk_publish *p)
{
    if (atomic_load_explicit(&p->middle, memory_order_relaxed) & FRESH)
        p->front = atomic_exchange_explicit(&p->middle, p->front, memory_order_acq_rel) & 3u;
    return &p->slot[p->front];
}

void mk_loop_get_stats(const struct mk_loop *loop, struct mk_loop_stats *out)
{
    *out = (struct mk_loop_stats){
        .ticks = atomic_load_explicit(&loop->ticks, memory_order_relaxed),
        .late = atomic_load_explicit(&loop->late, memory_order_relaxed),
        .overruns = atomic_load_explicit(&loop->overruns, memory_order_relaxed),
        .lost = atomic_load_explicit(&loop->lost, memory_order_relaxed),
        .gaps = atomic_load_explicit(&loop->gaps, memory_order_relaxed),
        .dropped = atomic_load_explicit(&loop->dropped, memory_order_relaxed),
        .late_p50_us = mk_histogram_percentile_us(&loop->lateness, 0.50),
        .late_p99_us = mk_histogram_percentile_us(&loop->lateness, 0.99),
        .late_p999_us = mk_histogram_percentile_us(&loop->lateness, 0.999),
        .late_max_us = mk_histogram_max_us(&loop->lateness),
        .busy_mean_us = mk_histogram_mean_us(&loop->busy),
        .busy_max_us = mk_histogram_max_us(&loop->busy),
        .realtime = loop->host.realtime,
        .memory_locked = loop->host.memory_locked,
    };
    memcpy(out->note, loop->host.note, sizeof out->note);
}

/* Small repeatable random numbers for noise (splitmix64; Steele, Lea, Flood 2014). The same seed
 * gives the same sequence on every machine. RT-safe. */
#ifndef MECHKIT_BASE_RANDOM_H
#define MECHKIT_BASE_RANDOM_H

#include <math.h>
#include <stdint.h>

struct mk_random {
    uint64_t state;
};

static inline uint64_t mk_random_next(struct mk_random *r)
{
    uint64_t z = (r->state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

/* Uniform in [0, 1). */
static inline double mk_random_uniform(struct mk_random *r)
{
    return (double)(mk_random_next(r) >> 11) * 0x1.0p-53;
}

/* Standard normal (Box and Muller 1958; the second value is thrown away: no state to reset). */
static inline double mk_random_normal(struct mk_random *r)
{
    double radius = sqrt(-2.0 * log(1.0 - mk_random_uniform(r)));
    return radius * cos(2.0 * 3.14159265358979323846 * mk_random_uniform(r));
}

#endif

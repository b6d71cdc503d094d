/* Episodes: what a bad day is made of, drawn from a seed. */
#ifndef MECHKIT_TOOLS_SOAK_EPISODE_H
#define MECHKIT_TOOLS_SOAK_EPISODE_H

#include "base/random.h"
#include "watch.h"

#define EPISODE_LINES 80

enum episode_kind {
    EPISODE_SIMULATED, /* several runs in simulated time */
    EPISODE_FULL_DISK, /* the same, and the disk fills up in the middle */
    EPISODE_KILLED,    /* the same in a process of its own, killed at some time */
    EPISODE_CLOCK,     /* in real time, and the clock jumps */
    EPISODE_GARBAGE,   /* a command file with bytes changed: refused, or executed */
    EPISODE_KINDS
};
extern const char *const episode_name[EPISODE_KINDS];

/* A random command file: lines without line ends. */
struct script {
    int count;
    char line[EPISODE_LINES][400];
    int faults, changes; /* rules of fault scripts in it, and gains and parameters set */
};
void script_draw(struct script *s, struct mk_random *random, bool real_time);
double draw_between(struct mk_random *random, double low, double high);
int draw_below(struct mk_random *random, int n);

struct tally {
    long episodes[EPISODE_KINDS], commands, refused, runs, rows, rules, changes, kills, full_disks,
        clock_steps;
    long latched[MK_FAULT_COUNT];
    double simulated_s, real_s;
};

/* Plays one in `folder` (empty before and after); what must not be goes to `v`. */
void episode_play(enum episode_kind kind, uint64_t seed, const char *folder, struct tally *tally,
                  struct violation *v);

#endif

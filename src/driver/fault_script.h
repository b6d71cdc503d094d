/* The fault script of the virtual board: what goes wrong at which sample (docs/faults.md). */
#ifndef MECHKIT_DRIVER_FAULT_SCRIPT_H
#define MECHKIT_DRIVER_FAULT_SCRIPT_H

#include <stdbool.h>
#include <stdint.h>

#include "mechkit/model.h"
#include "mechkit/status.h"

#define MK_FAULT_RULES_MAX 64

enum mk_fault_action {
    MK_FAULT_DROP,       /* the request never arrives: no reading, the old command stays */
    MK_FAULT_MUTE,       /* the answer never arrives: no reading, but the command acts */
    MK_FAULT_DELAY,      /* the answer comes `value` seconds later */
    MK_FAULT_STICK,      /* counter of `joint` stands still */
    MK_FAULT_SLIP,       /* counter of `joint` jumps by `value` counts */
    MK_FAULT_NOISE,      /* readings jitter with a standard deviation of `value` counts */
    MK_FAULT_SATURATE,   /* the amplifier gives no more than `value` command units */
    MK_FAULT_ALARM,      /* the board reports a fault of its own */
    MK_FAULT_DISCONNECT, /* the board is gone from here on */
    MK_FAULT_ACTION_COUNT
};

struct mk_fault_rule {
    enum mk_fault_action action;
    uint64_t first, end; /* samples first <= n < end; UINT64_MAX: for good */
    int joint;           /* 0-based */
    double value;
};

struct mk_fault_script {
    int count;
    struct mk_fault_rule rule[MK_FAULT_RULES_MAX];
};

/* Reads `source`: the path of a file, or the rules themselves when it starts with "at " or "from "
 * or holds a ';' or a newline. NULL or "": no rules. MK_ERR_PARSE and MK_ERR_RANGE name line and
 * column, MK_ERR_NOTFOUND, MK_ERR_IO. Not RT. */
MK_NODISCARD enum mk_status mk_fault_script_read(const char *source, int joints,
                                                 struct mk_fault_script *out, struct mk_error *err);

/* What the script asks for at one sample, all its rules together. */
struct mk_fault_effects {
    bool drop, mute, alarm, disconnect;
    double delay_s;
    double noise_counts;
    double u_limit; /* INFINITY: none */
    bool stuck[MK_MAX_JOINTS];
    int32_t slip[MK_MAX_JOINTS]; /* counts to add from this sample on */
};
/* RT. */
void mk_fault_script_at(const struct mk_fault_script *script, uint64_t sample,
                        struct mk_fault_effects *out);

#endif

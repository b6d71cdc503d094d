/* Which experiment tells most next. A forecast of the model under each input that is thought of
 * says what its readings would tell about the model's parameters and about effects that rigs
 * usually have and this model has not (ident/information.hpp), beside what the inputs that were run
 * have told. docs/investigate.md. */
#ifndef MECHKIT_INVESTIGATE_PLAN_H
#define MECHKIT_INVESTIGATE_PLAN_H

#include <stdbool.h>

#include "mechkit/excite.h"
#include "mechkit/model.h"
#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define PLAN_INPUT 1024
#define PLAN_MAX_PAST 64
#define PLAN_MAX_SUSPECTS 8

/* What an input has to keep to, on the rig as it is predicted. */
struct plan_limits {
    double u_max;
    double q_min[MK_MAX_JOINTS], q_max[MK_MAX_JOINTS]; /* rad or m, as the log has them */
    double v_max[MK_MAX_JOINTS];
};

struct plan_suspect {
    const struct mk_effect_info *effect;
    int joint; /* 1-based; 0: none */
};

struct plan_query {
    const struct mk_model *model; /* as it is known now */
    double spread;                /* how far its parameters may be off, relative */
    struct plan_limits limits;
    double seconds, rate_hz;
    double noise[MK_MAX_JOINTS]; /* of a reading */
    double process_noise;        /* process noise of the speeds, rad/s per sqrt(s) */
    int past_count;              /* inputs that were run, and for how long */
    const char *past[PLAN_MAX_PAST];
    double past_s[PLAN_MAX_PAST];
    int suspect_count; /* beside those that every rig is suspected of */
    struct plan_suspect suspect[PLAN_MAX_SUSPECTS];
    int tries; /* of the search for the first input */
    int threads;
    uint64_t seed;
    mk_progress_fn progress;
    void *progress_context;
};

struct plan {
    char input[PLAN_INPUT]; /* signal (mechkit/signal.h), from rest */
    double gain;            /* nats: how much smaller what is not known well becomes */
    char about[96];         /* what becomes known most: "p3", "coulomb at joint 2" */
    double before, after;   /* its relative standard error */
    char kind[64];          /* of the movement, in words: "slow reversals" */
};

/* The input that tells most about base parameters and usual suspects (mk_excite), for a rig of
 * which only a textbook model is known. What mk_excite returns. */
MK_NODISCARD enum mk_status plan_first(const struct plan_query *q, struct plan *out,
                                       struct mk_error *err);
/* The input that makes what is least known known best. False: none within the limits. */
bool plan_telling(const struct plan_query *q, struct plan *out);
/* The input under which the model's prediction is the least sure of itself: none is a better test
 * of it. None that was run. False: none within the limits. */
bool plan_test(const struct plan_query *q, struct plan *out);
/* An input that shows a rest that goes with `with` ("sign(dq1)", "u", "q2", ...; NULL: nobody
 * knows) best, and was not run. False: none is left within the limits. */
bool plan_probe(const struct plan_query *q, const char *with, struct plan *out);
/* Whether an input keeps to the limits. */
bool plan_keeps(const struct plan_query *q, const char *input);

#ifdef __cplusplus
}
#endif
#endif

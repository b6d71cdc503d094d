/* An investigation while it goes on, for the files that it consists of: investigate.c (the road),
 * understand.c (what all logs say together). */
#ifndef MECHKIT_INVESTIGATE_INVESTIGATION_H
#define MECHKIT_INVESTIGATE_INVESTIGATION_H

#include "investigate/investigate.h"
#include "investigate/runs.h"
#include "mechkit/explain.h"
#include "mechkit/log.h"

#define INVESTIGATION_WINDOW_S 1.0 /* of the free runs that a prediction is judged by */

struct investigation {
    const struct investigate_options *o;
    struct journal *j;
    struct rig rig;
    struct mk_model simulated, model; /* behind the virtual board; as it is known now */
    struct mk_model planned;          /* the latter, without its zeros */
    bool turned;                      /* zeros.h: the direction of an arm is free */
    struct mk_explanation *e, *other; /* of all logs so far; explained: it is filled; room */
    bool explained;
    struct mk_log *log[JOURNAL_EXPERIMENTS];
};

void investigation_say(const struct investigation *v, const char *format, ...) MK_PRINTF(2, 3);
bool investigation_cancelled(const struct investigation *v);
/* The callback of calculations (`context`: the investigation): false once a signal ends them. */
bool investigation_goes_on(void *context, double done, const char *what);

/* The log of an experiment (0-based), counted from the zero of the first; kept in v->log. */
MK_NODISCARD enum mk_status investigation_read_log(struct investigation *v, int number,
                                                   struct mk_error *err);
/* Explains the logs of the first `count` experiments, from the given model with its zeros free
 * (zeros.h); v->e, v->model and v->explained are what comes of it. An experiment that contradicts
 * all others is left out. */
MK_NODISCARD enum mk_status investigation_explain(struct investigation *v, int count,
                                                  struct mk_error *err);

#endif

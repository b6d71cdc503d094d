/* An investigation while it goes on, for the files that it consists of. */
#ifndef MECHKIT_INVESTIGATE_INVESTIGATION_H
#define MECHKIT_INVESTIGATE_INVESTIGATION_H

#include "investigate/doubt.h"
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

double investigation_now_s(void); /* of a clock that only goes forwards */
/* Journal and notebook. */
MK_NODISCARD enum mk_status investigation_save(struct investigation *v, struct mk_error *err);
/* The experiment that was planned last; NULL: none. */
struct experiment *investigation_last(const struct investigation *v);
/* Experiments that the budget counts: what was broken off from outside is not one. Those of them
 * that a fault of the rig ended. */
int investigation_counted(const struct journal *j);
int investigation_faults(const struct journal *j);
/* Time spent at the rig and in calculations, s. */
double investigation_spent_s(const struct journal *j);

/* The steps of the road, in their order. Each leaves the journal saved; a failure of one is tried
 * again by the next call of the program. */
MK_NODISCARD enum mk_status investigation_look(struct investigation *v, struct mk_error *err);
/* Plans the next experiment and writes down what the model predicts. */
MK_NODISCARD enum mk_status investigation_choose(struct investigation *v, struct mk_error *err);
MK_NODISCARD enum mk_status investigation_run(struct investigation *v, struct mk_error *err);
MK_NODISCARD enum mk_status investigation_judge(struct investigation *v, struct mk_error *err);
MK_NODISCARD enum mk_status investigation_learn(struct investigation *v, struct mk_error *err);
/* Whether it is over; says so in the journal, which is not saved. */
bool investigation_is_over(struct investigation *v);
/* Tries controllers with the given and the final model. */
MK_NODISCARD enum mk_status investigation_control(struct investigation *v, struct mk_error *err);

/* The log of an experiment (0-based), counted from the zero of the first; kept in v->log. *doubt:
 * as learn_read_log() finds it, none where the log was there; NULL: nobody asks. */
MK_NODISCARD enum mk_status investigation_read_log(struct investigation *v, int number,
                                                   struct doubt *doubt, struct mk_error *err);
/* Explains the logs of the first `count` experiments, from the given model with its zeros free
 * (zeros.h); v->e, v->model and v->explained are what comes of it. An experiment that contradicts
 * all others is left out. */
MK_NODISCARD enum mk_status investigation_explain(struct investigation *v, int count,
                                                  struct mk_error *err);

#endif

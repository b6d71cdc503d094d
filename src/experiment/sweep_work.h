/* The runs of a sweep handed out to threads, and to other processes under MPI. */
#ifndef MECHKIT_EXPERIMENT_SWEEP_WORK_H
#define MECHKIT_EXPERIMENT_SWEEP_WORK_H

#include <pthread.h>
#include <signal.h>

#include "experiment/sweep.h"

/* Takes a result in; called by one thread at a time. */
typedef enum mk_status (*sweep_sink)(void *user, size_t index, int outcome, const char *text,
                                     struct mk_error *err);

struct sweep_queue {
    const struct sweep *sweep;
    const size_t *todo; /* indices of runs */
    size_t count;
    const volatile sig_atomic_t *cancel; /* may be NULL */
    sweep_sink sink;
    void *user;
    /* Below: behind the lock. */
    pthread_mutex_t lock;
    size_t next, back;     /* handed out, and come back */
    enum mk_status status; /* first failure: nothing more is handed out */
    struct mk_error err;
};

void sweep_queue_init(struct sweep_queue *q, const struct sweep *s, const size_t *todo,
                      size_t count, sweep_sink sink, void *user);
void sweep_queue_destroy(struct sweep_queue *q);
/* Hands out up to `most` runs: *first in todo. 0: there are no more. */
size_t sweep_queue_take(struct sweep_queue *q, size_t most, size_t *first);
void sweep_queue_put(struct sweep_queue *q, size_t index, int outcome, const char *text);
void sweep_queue_fail(struct sweep_queue *q, enum mk_status status, const char *message);

/* Threads that work a queue off. Where the system gives no more, fewer do; MK_ERR_NOMEM: none. */
struct sweep_team {
    pthread_t *thread;
    int count;
};
MK_NODISCARD enum mk_status sweep_team_start(struct sweep_team *team, struct sweep_queue *q,
                                             int threads, struct mk_error *err);
void sweep_team_join(struct sweep_team *team);

/* Processes that share a sweep. */
struct sweep_ranks {
    int rank, count; /* 0 of 1 without MPI */
    int local;       /* how many of them are on this machine */
    int threads;     /* of the process that has most; from sweep_ranks_agree on */
};
/* MK_ERR_NOTSUP: started by mpirun, but built without MPI. */
MK_NODISCARD enum mk_status sweep_ranks_open(struct sweep_ranks *r, struct mk_error *err);
void sweep_ranks_close(struct sweep_ranks *r);
/* True when every process says `fine`, with the same fingerprint. */
bool sweep_ranks_agree(struct sweep_ranks *r, bool fine, uint64_t fingerprint, int threads);
/* Rank 0: gives the others work until there is no more and theirs has come back. */
void sweep_ranks_serve(const struct sweep_ranks *r, struct sweep_queue *q);
/* The others: work until there is no more. */
MK_NODISCARD enum mk_status sweep_ranks_help(const struct sweep_ranks *r, const struct sweep *s,
                                             int threads, struct mk_error *err);

#endif

#include "experiment/sweep_work.h"

#include <stdio.h>
#include <stdlib.h>

void sweep_queue_init(struct sweep_queue *q, const struct sweep *s, const size_t *todo,
                      size_t count, sweep_sink sink, void *user)
{
    *q = (struct sweep_queue){
        .sweep = s, .todo = todo, .count = count, .sink = sink, .user = user, .err = MK_ERROR_INIT};
    pthread_mutex_init(&q->lock, NULL);
}

void sweep_queue_destroy(struct sweep_queue *q)
{
    pthread_mutex_destroy(&q->lock);
}

size_t sweep_queue_take(struct sweep_queue *q, size_t most, size_t *first)
{
    pthread_mutex_lock(&q->lock);
    bool end = q->status != MK_OK || (q->cancel && *q->cancel);
    size_t left = end ? 0 : q->count - q->next, n = most < left ? most : left;
    *first = q->next;
    q->next += n;
    pthread_mutex_unlock(&q->lock);
    return n;
}

void sweep_queue_put(struct sweep_queue *q, size_t index, int outcome, const char *text)
{
    pthread_mutex_lock(&q->lock);
    q->back++;
    if (q->status == MK_OK)
        q->status = q->sink(q->user, index, outcome, text, &q->err);
    pthread_mutex_unlock(&q->lock);
}

void sweep_queue_fail(struct sweep_queue *q, enum mk_status status, const char *message)
{
    pthread_mutex_lock(&q->lock);
    if (q->status == MK_OK)
        q->status = mk_error_set(&q->err, status, "%s", message);
    pthread_mutex_unlock(&q->lock);
}

static void *work(void *user)
{
    struct sweep_queue *q = user;
    size_t at;
    while (sweep_queue_take(q, 1, &at) > 0) {
        struct mk_error err = MK_ERROR_INIT;
        char text[SWEEP_LINE] = "";
        int outcome = 0;
        enum mk_status st = q->sweep->kind->run(q->sweep, q->todo[at], &outcome, text, &err);
        if (st == MK_OK) {
            sweep_queue_put(q, q->todo[at], outcome, text);
        } else {
            char message[sizeof err.message + 40];
            snprintf(message, sizeof message, "run %zu: %s", q->todo[at], err.message);
            sweep_queue_fail(q, st, message);
        }
    }
    return NULL;
}

enum mk_status sweep_team_start(struct sweep_team *team, struct sweep_queue *q, int threads,
                                struct mk_error *err)
{
    *team = (struct sweep_team){.thread = calloc((size_t)threads, sizeof *team->thread)};
    while (team->thread && team->count < threads &&
           pthread_create(&team->thread[team->count], NULL, work, q) == 0)
        team->count++;
    if (team->count > 0)
        return MK_OK;
    free(team->thread);
    return mk_error_set(err, MK_ERR_NOMEM, "cannot start threads");
}

void sweep_team_join(struct sweep_team *team)
{
    for (int i = 0; i < team->count; i++)
        pthread_join(team->thread[i], NULL);
    free(team->thread);
}

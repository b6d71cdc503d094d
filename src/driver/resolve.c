#include "driver/resolve.h"

#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>

/* What the asking thread and the resolver's share; the one that leaves last frees it. */
struct question {
    pthread_mutex_t lock;
    pthread_cond_t answered;
    bool done, given_up;
    char host[256], port[8];
    int flags, result;
    struct addrinfo *list;
};

static int ask(const char *host, const char *port, int flags, struct addrinfo **out)
{
    const struct addrinfo hints = {
        .ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM, .ai_flags = flags | AI_NUMERICSERV};
    return getaddrinfo(host, port, &hints, out);
}

static void forget(struct question *q)
{
    pthread_cond_destroy(&q->answered);
    pthread_mutex_destroy(&q->lock);
    free(q);
}

static void *resolver(void *user)
{
    struct question *q = user;
    struct addrinfo *list = NULL;
    int result = ask(q->host, q->port, q->flags, &list);
    pthread_mutex_lock(&q->lock);
    bool given_up = q->given_up;
    q->done = true;
    q->result = result;
    q->list = list;
    pthread_cond_signal(&q->answered);
    pthread_mutex_unlock(&q->lock);
    if (given_up) {
        if (result == 0)
            freeaddrinfo(list);
        forget(q);
    }
    return NULL;
}

/* Signals are for threads that know what to do with them. */
static int start(struct question *q)
{
    sigset_t all, before;
    pthread_attr_t attr;
    pthread_t thread;
    sigfillset(&all);
    pthread_attr_init(&attr);
    pthread_attr_setdetachstate(&attr, PTHREAD_CREATE_DETACHED);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int why = pthread_create(&thread, &attr, resolver, q);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    pthread_attr_destroy(&attr);
    return why;
}

static struct question *new_question(const char *host, const char *port, int flags)
{
    struct question *q = calloc(1, sizeof *q);
    pthread_condattr_t attr;
    if (!q || strlen(host) >= sizeof q->host || strlen(port) >= sizeof q->port) {
        free(q);
        return NULL;
    }
    strcpy(q->host, host);
    strcpy(q->port, port);
    q->flags = flags;
    pthread_mutex_init(&q->lock, NULL);
    pthread_condattr_init(&attr);
    pthread_condattr_setclock(&attr, CLOCK_MONOTONIC);
    pthread_cond_init(&q->answered, &attr);
    pthread_condattr_destroy(&attr);
    return q;
}

int mk_resolve(const char *host, const char *port, int flags, int64_t deadline_ns,
               struct addrinfo **out)
{
    int result = ask(host, port, flags | AI_NUMERICHOST, out);
    if (result != EAI_NONAME)
        return result;
    struct question *q = new_question(host, port, flags);
    if (!q)
        return EAI_MEMORY;
    if (start(q) != 0) {
        forget(q);
        return EAI_MEMORY;
    }
    const struct timespec until = {deadline_ns / 1000000000, deadline_ns % 1000000000};
    pthread_mutex_lock(&q->lock);
    while (!q->done && pthread_cond_timedwait(&q->answered, &q->lock, &until) != ETIMEDOUT)
        continue;
    bool done = q->done;
    result = done ? q->result : EAI_AGAIN;
    *out = q->list;
    q->given_up = !done;
    pthread_mutex_unlock(&q->lock);
    if (done)
        forget(q);
    return result;
}

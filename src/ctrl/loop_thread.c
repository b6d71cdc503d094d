/* The real-time thread, and what is asked of the operating system for it. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include "ctrl/loop_priv.h"

#define STACK_BYTES (512 * 1024)
#define PREFAULT_BYTES (64 * 1024)

/* Sanitizers map terabytes of shadow memory, which must not be locked. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define MAY_LOCK_MEMORY 0
#else
#define MAY_LOCK_MEMORY 1
#endif

static void wait_for(sem_t *sem)
{
    while (sem_wait(sem) != 0 && errno == EINTR)
        ;
}

/* Touches the stack that a tick will use, so that no page is missing later. */
static void prefault_stack(void)
{
    volatile char page[PREFAULT_BYTES];
    for (size_t i = 0; i < sizeof page; i += 1024)
        page[i] = 0;
    (void)page[0];
}

static void *loop_thread(void *arg)
{
    struct mk_loop *loop = arg;
    prefault_stack();
    prctl(PR_SET_NAME, "mechkit-loop");
    /* Without SCHED_FIFO timers may come 50 us late by design; ask for less. */
    prctl(PR_SET_TIMERSLACK, 1UL);
    sem_post(&loop->host.ready);
    wait_for(&loop->host.go);
    if (loop->host.abandoned)
        return NULL;

    /* Here and not in the host thread: the watchdog's time begins now. */
    loop->host.prologue = mk_loop_begin_ticks(loop, &loop->host.prologue_error);
    bool well = loop->host.prologue == MK_OK;
    sem_post(&loop->host.ready);

    while (well && !atomic_load_explicit(&loop->stop, memory_order_relaxed))
        well = mk_loop_tick(loop);
    mk_loop_end_ticks(loop);
    return NULL;
}

/* --- what the process is given --------------------------------------------------------------- */

/* Locking what is to come as well makes later allocations fail once a limit is reached, so it is
 * asked for only where there is none. */
static bool lock_memory(int *os_error)
{
    struct rlimit limit;
    bool unlimited = geteuid() == 0 ||
                     (getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY);
    *os_error = 0;
    if (!MAY_LOCK_MEMORY)
        return false;
    if (mlockall(unlimited ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT) == 0)
        return true;
    *os_error = errno;
    return false;
}

/* Keeps the processor out of deep sleep states, from which it wakes late. */
static int hold_dma_latency(void)
{
    int fd = open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
    int32_t zero = 0;
    if (fd >= 0 && write(fd, &zero, sizeof zero) != sizeof zero) {
        close(fd);
        fd = -1;
    }
    return fd;
}

static void explain_grants(struct mk_loop *loop, int lock_error)
{
    const char *sched = "", *memory = "", *both = "";
    if (loop->config.priority > 0 && !loop->host.realtime)
        sched = "no real-time priority (ulimit -r 80)";
    if (!MAY_LOCK_MEMORY)
        memory = "memory not locked (sanitizer build)";
    else if (lock_error)
        memory = "memory not locked (ulimit -l unlimited)";
    if (sched[0] && memory[0])
        both = "; ";
    const char *remedy = sched[0] || lock_error ? ": join plugdev, log in again; docs/boards.md, "
                                                  "Real time"
                                                : "";
    snprintf(loop->host.note, sizeof loop->host.note, "%s%s%s%s", sched, both, memory, remedy);
}

/* --- the thread's life ----------------------------------------------------------------------- */

/* Signals are the host thread's affair. */
static int create_masked(pthread_t *thread, const pthread_attr_t *attr, void *(*body)(void *),
                         void *arg)
{
    sigset_t all, old;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &old);
    int rc = pthread_create(thread, attr, body, arg);
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    return rc;
}

static int create_thread(struct mk_loop *loop, bool fifo)
{
    pthread_attr_t attr;
    int rc = pthread_attr_init(&attr);
    if (rc != 0)
        return rc;
    pthread_attr_setstacksize(&attr, STACK_BYTES);
    if (fifo) {
        const struct sched_param param = {.sched_priority = loop->config.priority};
        pthread_attr_setinheritsched(&attr, PTHREAD_EXPLICIT_SCHED);
        pthread_attr_setschedpolicy(&attr, SCHED_FIFO);
        rc = pthread_attr_setschedparam(&attr, &param);
    }
    if (rc == 0)
        rc = create_masked(&loop->host.thread, &attr, loop_thread, loop);
    pthread_attr_destroy(&attr);
    return rc;
}

enum mk_status mk_loop_thread_create(struct mk_loop *loop, struct mk_error *err)
{
    sem_init(&loop->host.ready, 0, 0);
    sem_init(&loop->host.go, 0, 0);
    loop->host.realtime = false;
    int rc = EPERM;
    if (loop->config.priority > 0)
        rc = create_thread(loop, true);
    if (rc == 0)
        loop->host.realtime = true;
    else
        rc = create_thread(loop, false);
    if (rc != 0) {
        sem_destroy(&loop->host.ready);
        sem_destroy(&loop->host.go);
        return mk_error_errno(err, rc, NULL, "cannot create the loop's thread");
    }
    wait_for(&loop->host.ready);

    int lock_error = 0;
    loop->host.memory_locked = lock_memory(&lock_error);
    if (loop->host.dma_latency_fd < 0)
        loop->host.dma_latency_fd = hold_dma_latency();
    explain_grants(loop, lock_error);
    return MK_OK;
}

enum mk_status mk_loop_thread_go(struct mk_loop *loop, bool abandon, struct mk_error *err)
{
    loop->host.abandoned = abandon;
    sem_post(&loop->host.go);
    if (!abandon)
        wait_for(&loop->host.ready);
    if (!abandon && loop->host.prologue == MK_OK)
        return MK_OK;
    mk_loop_thread_join(loop);
    if (abandon)
        return MK_OK;
    if (err)
        *err = loop->host.prologue_error;
    return loop->host.prologue;
}

void mk_loop_thread_join(struct mk_loop *loop)
{
    pthread_join(loop->host.thread, NULL);
    sem_destroy(&loop->host.ready);
    sem_destroy(&loop->host.go);
    if (loop->host.dma_latency_fd >= 0)
        close(loop->host.dma_latency_fd);
    loop->host.dma_latency_fd = -1;
}

void mk_loop_thread_release(struct mk_loop *loop)
{
    if (loop->host.memory_locked)
        munlockall();
    loop->host.memory_locked = false;
}

/* --- the writer's thread --------------------------------------------------------------------- */

static void *writer_thread(void *arg)
{
    struct mk_loop_writer *w = arg;
    prctl(PR_SET_NAME, "mechkit-log");
    while (!atomic_load_explicit(&w->stop, memory_order_acquire)) {
        mk_loop_writer_drain(w);
        const struct timespec pause = {.tv_nsec = 20000000};
        nanosleep(&pause, NULL);
    }
    return NULL;
}

enum mk_status mk_loop_writer_spawn(struct mk_loop_writer *w, struct mk_error *err)
{
    if (!w->log)
        return MK_OK;
    atomic_store_explicit(&w->stop, false, memory_order_relaxed);
    int rc = create_masked(&w->thread, NULL, writer_thread, w);
    if (rc != 0)
        return mk_error_errno(err, rc, NULL, "cannot create the log's thread");
    w->threaded = true;
    return MK_OK;
}

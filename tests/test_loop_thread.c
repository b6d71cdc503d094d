/* What the real-time thread asks of the operating system, and that a run says what it was given. */
#include "suites.h"

#include <ctype.h>
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <pthread.h>
#include <sched.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "ctrl/loop_priv.h"
#include "emu/node.h"
#include "mechkit/loop.h"
#include "support/bench.h"
#include "support/files.h"
#include "support/wall.h"

static struct mk_loop_stats stats(void)
{
    struct mk_loop_stats s;
    mk_loop_get_stats(bench.loop, &s);
    return s;
}

/* The line of a file under /proc/self that begins with `key`: what is behind it; "" when none. */
static const char *proc_line(const char *file, const char *key)
{
    static char line[256];
    char path[300];
    snprintf(path, sizeof path, "/proc/self/%s", file);
    FILE *f = fopen(path, "r");
    bool found = false;
    while (f && !found && fgets(line, sizeof line, f))
        found = strncmp(line, key, strlen(key)) == 0;
    if (f)
        fclose(f);
    line[strcspn(line, "\n")] = '\0';
    return found ? line + strlen(key) : "";
}

static long locked_kb(void)
{
    return strtol(proc_line("status", "VmLck:"), NULL, 10);
}

/* The thread of this process that has this name; 0 when there is none. */
static pid_t thread_named(const char *name)
{
    DIR *all = opendir("/proc/self/task");
    pid_t found = 0;
    for (struct dirent *one; all && !found && (one = readdir(all)) != NULL;) {
        char file[280];
        snprintf(file, sizeof file, "task/%s/comm", one->d_name);
        if (isdigit((unsigned char)one->d_name[0]) && strcmp(proc_line(file, ""), name) == 0)
            found = (pid_t)atoi(one->d_name);
    }
    if (all)
        closedir(all);
    return found;
}

static bool is_open(const char *path)
{
    DIR *all = opendir("/proc/self/fd");
    bool found = false;
    for (struct dirent *one; all && !found && (one = readdir(all)) != NULL;) {
        char to[300] = "", link[300];
        snprintf(link, sizeof link, "/proc/self/fd/%s", one->d_name);
        found = readlink(link, to, sizeof to - 1) > 0 && strcmp(to, path) == 0;
    }
    if (all)
        closedir(all);
    return found;
}

static void run_a_moment(void)
{
    bench_build(NULL);
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.05), MK_OK);
}

START_TEST(a_run_says_what_it_was_given_for_real_time)
{
    bench_use_real_time(500);
    run_a_moment();
    const pid_t thread = thread_named("mechkit-loop");
    ck_assert_int_gt(thread, 0);
    const int policy = sched_getscheduler(thread);
    struct mk_loop_stats s = stats();
    ck_assert_int_eq(s.realtime, policy == SCHED_FIFO);
    ck_assert_int_eq(s.memory_locked, locked_kb() > 0);
    ck_assert_int_eq(strstr(s.note, "no real-time priority") == NULL, s.realtime);
    ck_assert_int_eq(strstr(s.note, "memory not locked") == NULL, s.memory_locked);
    ck_assert_int_eq(s.note[0] == '\0', s.realtime && s.memory_locked);
    struct sched_param param;
    ck_assert_int_eq(sched_getparam(thread, &param), 0);
    ck_assert_int_eq(param.sched_priority, s.realtime ? bench.config.priority : 0);
}
END_TEST

static void *do_nothing(void *user)
{
    return user;
}

/* Whether this process may have a thread of the loop's priority. */
static bool may_have_priority(void)
{
    const struct sched_param param = {.sched_priority = bench.config.priority};
    pthread_attr_t attr;
    pthread_t thread;
    pthread_attr_init(&attr);
    pthread_attr_setinheritsched(&attr, PTHREAD_EXPLICIT_SCHED);
    pthread_attr_setschedpolicy(&attr, SCHED_FIFO);
    pthread_attr_setschedparam(&attr, &param);
    bool may = pthread_create(&thread, &attr, do_nothing, NULL) == 0;
    if (may)
        pthread_join(thread, NULL);
    pthread_attr_destroy(&attr);
    return may;
}

START_TEST(a_run_has_the_priority_that_it_may_have)
{
    bench_use_real_time(500);
    run_a_moment();
    ck_assert_int_eq(stats().realtime, may_have_priority());
}
END_TEST

/* What a tick takes is told, and it is no more than a run lasts. */
START_TEST(a_run_says_how_long_its_ticks_take)
{
    bench_use_real_time(500);
    run_a_moment();
    ck_assert_double_gt(stats().busy_mean_us, 0.0);
    ck_assert_double_ge(stats().busy_max_us, stats().busy_mean_us);
    ck_assert_double_lt(stats().busy_max_us, 60e6);
    /* Of this run, not of one before it. */
    bench_halt();
    mk_histogram_add(&bench.loop->busy, INT64_C(3600000000000));
    mk_histogram_add(&bench.loop->lateness, INT64_C(3600000000000));
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.05), MK_OK);
    ck_assert_double_lt(stats().busy_max_us, 60e6);
    ck_assert_double_lt(stats().late_max_us, 60e6);
}
END_TEST

/* The board, and whoever draws the picture, share the processor with the host thread. */
START_TEST(a_host_that_waits_sleeps_whether_something_runs_or_not)
{
    bench_use_real_time(500);
    run_a_moment();
    for (int runs = 1; runs >= 0; runs--) {
        struct rusage before, after;
        ck_assert_int_eq(getrusage(RUSAGE_THREAD, &before), 0);
        ck_assert_int_eq(bench_wait_for(0.3), MK_OK);
        ck_assert_int_eq(getrusage(RUSAGE_THREAD, &after), 0);
        /* It gives the processor up of itself, again and again. */
        ck_assert_int_ge(after.ru_nvcsw - before.ru_nvcsw, 10);
        bench_halt();
    }
}
END_TEST

/* A board that does not answer for a second holds up its own thread alone. */
START_TEST(a_change_that_a_slow_board_keeps_from_being_taken_is_refused_in_time)
{
    const double value[PARAM_COUNT] = {1, 1, 1e18, 1e18};
    struct mk_error err = MK_ERROR_INIT;
    bench_use_real_time(500);
    bench_build("at 50 delay 1000ms");
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.09), MK_OK);
    usleep(100000);
    ck_assert_int_eq(mk_loop_set_params(bench.loop, value, PARAM_COUNT, &err), MK_OK);
    double begin = wall_s();
    ck_assert_int_eq(mk_loop_set_params(bench.loop, value, PARAM_COUNT, &err), MK_ERR_BUSY);
    ck_assert_int_eq(mk_loop_set_signal(bench.loop, NULL, &err), MK_ERR_BUSY);
    ck_assert_double_lt(wall_s() - begin, 0.5);
}
END_TEST

START_TEST(a_loop_that_asks_for_no_priority_has_none_and_misses_none)
{
    bench_use_real_time(500);
    bench.config.priority = 0;
    run_a_moment();
    ck_assert_int_eq(sched_getscheduler(thread_named("mechkit-loop")), SCHED_OTHER);
    ck_assert(!stats().realtime);
    ck_assert_ptr_null(strstr(stats().note, "priority"));
}
END_TEST

/* What the loop takes of the machine it gives back: processors may sleep deeply again after a run,
 * memory may be swapped once the loop is gone. */
START_TEST(what_was_taken_for_real_time_is_given_back)
{
    static const char latency[] = "/dev/cpu_dma_latency";
    bool may = access(latency, W_OK) == 0;
    bench_use_real_time(500);
    run_a_moment();
    ck_assert_int_eq(is_open(latency), may);
    for (int again = 0; again < 2; again++) {
        bench_halt();
        ck_assert(!is_open(latency));
        ck_assert_int_eq(thread_named("mechkit-loop"), 0);
        ck_assert_int_eq(thread_named("mechkit-log"), 0);
        bench_start();
        ck_assert_int_eq(bench_wait_for(0.05), MK_OK);
        ck_assert_int_eq(is_open(latency), may);
    }
    bench_drop_loop();
    ck_assert(!is_open(latency));
    ck_assert_int_eq(locked_kb(), 0);
}
END_TEST

static int takes_nothing(void *ctx, unsigned long request, void *arg)
{
    (void)ctx, (void)request, (void)arg;
    return -ENOTTY;
}

/* Its number may be another file's by the time that the run ends. */
START_TEST(a_latency_that_is_not_taken_is_let_go_at_once)
{
    const struct emu_node_ops ops = {.ioctl = takes_nothing}; /* a write fails with EINVAL */
    struct emu_node node = {.path = "/dev/cpu_dma_latency", .ops = &ops};
    emu_node_add(&node);
    bench_use_real_time(500);
    run_a_moment();
    ck_assert_int_eq(node.write_fd, -1);
    ck_assert_int_eq(bench.loop->host.dma_latency_fd, -1);
    bench_halt();
    emu_node_remove(&node);
}
END_TEST

/* Where memory is locked all of it is taken, however little a tick needs. */
START_TEST(the_stack_of_the_loop_is_no_larger_than_it_has_to_be)
{
    pthread_attr_t attr;
    size_t size = 0;
    bench_use_real_time(500);
    run_a_moment();
    ck_assert_int_eq(pthread_getattr_np(bench.loop->host.thread, &attr), 0);
    ck_assert_int_eq(pthread_attr_getstacksize(&attr, &size), 0);
    ck_assert_uint_ge(size, 256 * 1024);
    ck_assert_uint_le(size, 1024 * 1024);
    pthread_attr_destroy(&attr);
}
END_TEST

/* How often a thread of this name gave its processor up of itself. */
static long pauses_of(const char *name)
{
    char file[64];
    snprintf(file, sizeof file, "task/%d/status", (int)thread_named(name));
    return strtol(proc_line(file, "voluntary_ctxt_switches:"), NULL, 10);
}

/* On a machine with one processor it would keep the host from everything else. */
START_TEST(whoever_writes_the_log_sleeps_in_between)
{
    bench_use_real_time(500);
    run_a_moment();
    const long before = pauses_of("mechkit-log");
    ck_assert_int_eq(bench_wait_for(0.4), MK_OK);
    const long pauses = pauses_of("mechkit-log") - before;
    ck_assert_msg(pauses >= 5 && pauses <= 100, "%ld", pauses);
}
END_TEST

/* A handler that ran there would hold up a tick, or the log. */
START_TEST(signals_are_for_the_host_thread_alone)
{
    static const char *const threads[] = {"mechkit-loop", "mechkit-log"};
    char before[64];
    snprintf(before, sizeof before, "%s", proc_line("status", "SigBlk:"));
    bench_use_real_time(500);
    run_a_moment();
    ck_assert_str_eq(proc_line("status", "SigBlk:"), before);
    for (int i = 0; i < 2; i++) {
        char file[64];
        const pid_t thread = thread_named(threads[i]);
        ck_assert_int_gt(thread, 0);
        snprintf(file, sizeof file, "task/%d/status", (int)thread);
        const unsigned long long blocked = strtoull(proc_line(file, "SigBlk:"), NULL, 16);
        for (int signal = 1; signal < 32; signal++)
            ck_assert(signal == 9 || signal == 19 || (blocked >> (signal - 1) & 1));
    }
}
END_TEST

/* Late timers are coalesced with others by default. */
START_TEST(the_timers_of_the_loop_are_not_put_off)
{
    bench_use_real_time(500);
    bench.config.priority = 0;
    run_a_moment();
    char file[64];
    snprintf(file, sizeof file, "%d/timerslack_ns", (int)thread_named("mechkit-loop"));
    char path[100];
    snprintf(path, sizeof path, "/proc/%s", file);
    FILE *f = fopen(path, "r");
    long slack = -1;
    if (f && fscanf(f, "%ld", &slack) == 1)
        ck_assert_int_le(slack, 1);
    if (f)
        fclose(f);
}
END_TEST

/* In a process of its own: privileges do not come back. */
static int run_without_privileges(void)
{
    const struct rlimit none = {0, 0};
    bench_use_real_time(500);
    bench_build(NULL);
    if (setrlimit(RLIMIT_RTPRIO, &none) != 0 || setrlimit(RLIMIT_MEMLOCK, &none) != 0 ||
        (geteuid() == 0 && setresuid(65534, 65534, 65534) != 0))
        return 1;
    if (mk_loop_start(bench.loop, NULL, NULL, 0, NULL) != MK_OK || bench_wait_for(0.05) != MK_OK)
        return 2;
    struct mk_loop_stats s = stats();
    if (s.realtime || s.memory_locked || locked_kb() != 0)
        return 3;
    if (strncmp(s.note, "no real-time priority (ulimit -r 80); memory not locked (", 56) != 0)
        return 4;
    if (!strstr(s.note, ": join plugdev, log in again; docs/boards.md, Real time"))
        return 5;
    return mk_loop_halt(bench.loop, NULL) == MK_OK ? 0 : 6;
}

START_TEST(without_privileges_a_run_goes_on_and_says_what_it_lacks_and_what_to_do)
{
    pid_t pid = fork();
    ck_assert_int_ge(pid, 0);
    if (pid == 0)
        _exit(run_without_privileges());
    int status;
    ck_assert_int_eq(waitpid(pid, &status, 0), pid);
    ck_assert_msg(WIFEXITED(status) && WEXITSTATUS(status) == 0, "status %x", status);
}
END_TEST

/* Stand before libc's while a test pretends: who asks, and what limits the memory that may be
 * locked (0: that cannot be told). What is asked for is kept, and nothing locked. */
static struct {
    bool on;
    uid_t user;
    rlim_t limit;
    int asked;
} pretended;

uid_t geteuid(void)
{
    return pretended.on ? pretended.user : (uid_t)syscall(SYS_geteuid);
}

int getrlimit(__rlimit_resource_t what, struct rlimit *out)
{
    if (!pretended.on)
        return (int)syscall(SYS_prlimit64, 0, what, NULL, out);
    *out = (struct rlimit){pretended.limit, pretended.limit};
    return pretended.limit > 0 ? 0 : -1;
}

int mlockall(int flags)
{
    pretended.asked = flags;
    return pretended.on ? 0 : (int)syscall(SYS_mlockall, flags);
}

/* Where there is a limit, memory that is taken later would come up against it. */
START_TEST(memory_that_is_taken_later_is_locked_where_nothing_limits_it)
{
    static const struct {
        uid_t user;
        rlim_t limit;
        bool later;
    } rows[] = {
        {1000, RLIM_INFINITY, true}, {1000, 1 << 30, false}, {1000, 0, false}, {0, 1 << 30, true}};
    bench_use_real_time(500);
    bench_build(NULL);
    pretended.on = true;
    pretended.user = rows[_i].user;
    pretended.limit = rows[_i].limit;
    bench_start();
    pretended.on = false;
    if (stats().memory_locked) /* sanitizers lock none */
        ck_assert_int_eq(pretended.asked, rows[_i].later ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT);
    bench_halt();
}
END_TEST

/* Memory that is not locked would else come page by page, in the middle of ticks. */
START_TEST(the_stack_of_the_loop_is_there_before_a_tick_needs_it)
{
    static unsigned char there[4096];
    pthread_attr_t attr;
    void *stack;
    size_t size, pages = 0;
    const size_t page = (size_t)sysconf(_SC_PAGESIZE);
    bench_use_real_time(500);
    bench_build(NULL);
    pretended.on = true;
    pretended.user = 1000;
    pretended.limit = 1;
    bench_start();
    pretended.on = false;
    ck_assert_int_eq(pthread_getattr_np(bench.loop->host.thread, &attr), 0);
    ck_assert_int_eq(pthread_attr_getstack(&attr, &stack, &size), 0);
    pthread_attr_destroy(&attr);
    ck_assert_uint_le(size / page, sizeof there);
    ck_assert_int_eq(mincore(stack, size, there), 0);
    for (size_t i = 0; i < size / page; i++)
        pages += there[i] & 1;
    ck_assert_uint_ge(pages * page, 64 * 1024);
    bench_halt();
}
END_TEST

/* The sanitizer of threads has to see every semaphore itself. */
#ifndef __SANITIZE_THREAD__
/* Stands before libc's: a signal comes as often as `interrupted` while somebody waits. */
static atomic_int interrupted;

__attribute__((visibility("default"))) int sem_wait(sem_t *sem)
{
    static int (*next)(sem_t *);
    if (atomic_load(&interrupted) > 0 && atomic_fetch_sub(&interrupted, 1) > 0) {
        errno = EINTR;
        return -1;
    }
    if (!next)
        next = (__typeof__(next))dlsym(RTLD_NEXT, "sem_wait");
    return next(sem);
}

START_TEST(signals_while_a_run_is_started_do_not_start_it_early)
{
    bench_use_real_time(500);
    bench_build(NULL);
    atomic_store(&interrupted, 20);
    bench_start();
    ck_assert_int_le(atomic_load(&interrupted), 0);
    ck_assert_int_eq(bench_wait_for(0.05), MK_OK);
    bench_halt();
}
END_TEST
#endif

/* A call that a signal had cut short some time before. */
START_TEST(what_was_interrupted_before_holds_up_no_start)
{
    bench_use_real_time(500);
    bench_build(NULL);
    errno = EINTR;
    bench_run(0.05);
}
END_TEST

/* The thread is there before the log is: it must go again, and the next start must be possible. */
START_TEST(a_start_whose_log_cannot_be_made_leaves_no_thread_behind)
{
    bench_use_real_time(500);
    bench_build(NULL);
    ck_assert_int_ne(mk_loop_start(bench.loop, "/no/such/folder/log.csv", NULL, 0, NULL), MK_OK);
    ck_assert_int_eq(thread_named("mechkit-loop"), 0);
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
    bench_start();
    ck_assert_int_eq(bench_wait_for(0.05), MK_OK);
    ck_assert_int_gt(bench_look().ticks, 10);
    bench_halt();
}
END_TEST

static enum mk_status refused_watchdog(struct mk_board *board, unsigned ms, struct mk_error *err)
{
    (void)board;
    (void)ms;
    return mk_error_set(err, MK_ERR_IO, "no watchdog today");
}

/* In simulated and in real time. */
START_TEST(a_start_that_the_board_refuses_leaves_a_whole_log_and_no_thread)
{
    struct mk_error err = MK_ERROR_INIT;
    if (_i)
        bench_use_real_time(500);
    bench_build(NULL);
    bench_override_board()->set_watchdog = refused_watchdog;
    enum mk_status st = mk_loop_start(bench.loop, bench.path, NULL, 0, &err);
    bench_restore_board();
    ck_assert_int_eq(st, MK_ERR_IO);
    ck_assert_str_eq(err.message, "no watchdog today");
    ck_assert_int_eq(bench_look().state, MK_LOOP_IDLE);
    ck_assert_int_eq(thread_named("mechkit-loop") + thread_named("mechkit-log"), 0);
    ck_assert(!is_open(bench.path));
    char *text = slurp_file(bench.path);
    ck_assert_ptr_nonnull(strstr(text, "\n# summary: 0 samples"));
    free(text);
    bench_run(0.05);
}
END_TEST

Suite *suite_loop_thread(void)
{
    Suite *s = suite_create("loop_thread");
    TCase *t = tcase_create("real time");
    tcase_add_checked_fixture(t, bench_setup, bench_teardown);
    tcase_set_timeout(t, 30);
    tcase_add_test(t, a_run_says_what_it_was_given_for_real_time);
    tcase_add_test(t, a_run_has_the_priority_that_it_may_have);
    tcase_add_test(t, a_run_says_how_long_its_ticks_take);
    tcase_add_test(t, a_host_that_waits_sleeps_whether_something_runs_or_not);
    tcase_add_test(t, a_change_that_a_slow_board_keeps_from_being_taken_is_refused_in_time);
    tcase_add_test(t, a_loop_that_asks_for_no_priority_has_none_and_misses_none);
    tcase_add_test(t, what_was_taken_for_real_time_is_given_back);
    tcase_add_test(t, a_latency_that_is_not_taken_is_let_go_at_once);
    tcase_add_test(t, the_stack_of_the_loop_is_no_larger_than_it_has_to_be);
    tcase_add_test(t, whoever_writes_the_log_sleeps_in_between);
    tcase_add_test(t, signals_are_for_the_host_thread_alone);
    tcase_add_test(t, the_timers_of_the_loop_are_not_put_off);
    tcase_add_test(t, without_privileges_a_run_goes_on_and_says_what_it_lacks_and_what_to_do);
    tcase_add_loop_test(t, memory_that_is_taken_later_is_locked_where_nothing_limits_it, 0, 4);
    tcase_add_test(t, the_stack_of_the_loop_is_there_before_a_tick_needs_it);
#ifndef __SANITIZE_THREAD__
    tcase_add_test(t, signals_while_a_run_is_started_do_not_start_it_early);
#endif
    tcase_add_test(t, what_was_interrupted_before_holds_up_no_start);
    tcase_add_test(t, a_start_whose_log_cannot_be_made_leaves_no_thread_behind);
    tcase_add_loop_test(t, a_start_that_the_board_refuses_leaves_a_whole_log_and_no_thread, 0, 2);
    suite_add_tcase(s, t);
    return s;
}

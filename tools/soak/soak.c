/* Endurance: hours of simulated operation in one process, everything at random - setups, gains,
 * faults of the board, kills, full disks, clock steps, broken command files - and what must always
 * hold looked at all the time: the motor is off when nothing runs, logs are complete, no memory and
 * no file is lost.
 *
 *     soak MINUTES [FIRST [FOLDER]]
 *
 * An episode is drawn from its number: `soak 0 NUMBER` plays that one alone. */
#include <dirent.h>
#include <errno.h>
#include <malloc.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include "episode.h"

#define WARM_UP 200       /* episodes until memory is compared */
#define LEAK_BYTES 200000 /* more in use than after the warm-up: a leak */
#define BUSY_S 120        /* of processor time: an episode that takes more hangs */
#define STUCK_S 3600      /* by the clock, however busy the machine */

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int open_files(void)
{
    int n = 0;
    DIR *dir = opendir("/proc/self/fd");
    while (dir && readdir(dir))
        n++;
    if (dir)
        closedir(dir);
    return n;
}

static void empty_folder(const char *folder)
{
    DIR *dir = opendir(folder);
    for (struct dirent *e; dir && (e = readdir(dir));)
        if (e->d_name[0] != '.')
            unlinkat(dirfd(dir), e->d_name, 0);
    if (dir)
        closedir(dir);
}

static enum episode_kind draw_kind(uint64_t number)
{
    struct mk_random random = {number * 77773u};
    static const enum episode_kind often[] = {
        EPISODE_SIMULATED, EPISODE_SIMULATED, EPISODE_SIMULATED, EPISODE_FULL_DISK, EPISODE_KILLED,
        EPISODE_GARBAGE,   EPISODE_GARBAGE,   EPISODE_SIMULATED, EPISODE_FULL_DISK, EPISODE_CLOCK};
    return often[draw_below(&random, (int)(sizeof often / sizeof often[0]))];
}

static void on_stuck(int number)
{
    static const char text[] = "soak: an episode hangs\n";
    (void)number;
    (void)!write(STDERR_FILENO, text, sizeof text - 1);
    abort();
}

/* Both limits start anew. */
static void watch_for_hangs(bool on)
{
    struct itimerval busy = {.it_value = {.tv_sec = on ? BUSY_S : 0}};
    setitimer(ITIMER_PROF, &busy, NULL);
    alarm(on ? STUCK_S : 0);
}

static void print_tally(const struct tally *t, double minutes, size_t bytes, int files)
{
    printf("%.1f min: %.1f h simulated and %.0f s in real time, %ld runs, %ld rows, %ld commands "
           "(%ld refused)\n",
           minutes, t->simulated_s / 3600.0, t->real_s, t->runs, t->rows, t->commands, t->refused);
    printf("  injected: %ld fault rules, %ld kills, %ld full disks, %ld clock steps, %ld changed "
           "parameters; %zu kB in use, %d files\n  episodes:",
           t->rules, t->kills, t->full_disks, t->clock_steps, t->changes, bytes / 1024, files);
    for (int i = 0; i < EPISODE_KINDS; i++)
        printf(" %s %ld", episode_name[i], t->episodes[i]);
    printf("\n  latched:");
    for (int i = 1; i < MK_FAULT_COUNT; i++)
        printf(" %s %ld", mk_fault_name((enum mk_fault)i), t->latched[i]);
    putchar('\n');
    fflush(stdout);
}

int main(int argc, char **argv)
{
    double minutes = argc > 1 ? atof(argv[1]) : 1.0, begin = now_s(), told = begin;
    uint64_t number = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
    const char *folder = argc > 3 ? argv[3] : "soak-out";
    struct tally tally = {0};
    struct violation v = {.seen = false};
    size_t bytes = 0;
    int files = 0;
    signal(SIGXFSZ, SIG_IGN);
    signal(SIGPIPE, SIG_IGN);
    signal(SIGALRM, on_stuck);
    signal(SIGPROF, on_stuck);
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        perror(folder);
        return 2;
    }
    for (long played = 0; !v.seen && (played == 0 || now_s() - begin < 60.0 * minutes); played++) {
        empty_folder(folder);
        watch_for_hangs(true);
        episode_play(draw_kind(number), number, folder, &tally, &v);
        watch_for_hangs(false);
        if (played == WARM_UP) {
            bytes = mallinfo2().uordblks;
            files = open_files();
        }
        if (played > WARM_UP && mallinfo2().uordblks > bytes + LEAK_BYTES)
            violate(&v, "memory grows: %zu kB, now %zu kB", bytes / 1024,
                    mallinfo2().uordblks / 1024);
        if (played > WARM_UP && open_files() != files)
            violate(&v, "open files: %d, now %d", files, open_files());
        if (v.seen)
            fprintf(stderr, "soak: episode %llu (%s): %s\n", (unsigned long long)number,
                    episode_name[draw_kind(number)], v.text);
        if (now_s() - told > 60.0) {
            told = now_s();
            print_tally(&tally, (told - begin) / 60.0, mallinfo2().uordblks, open_files());
        }
        number++;
    }
    if (!v.seen)
        empty_folder(folder);
    print_tally(&tally, (now_s() - begin) / 60.0, mallinfo2().uordblks, open_files());
    printf("violations: %d\n", v.seen);
    return v.seen;
}

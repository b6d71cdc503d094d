/* Round trips to a board: how long an exchange takes at 1 kHz.
 *
 *     roundtrip [SECONDS [RATE_HZ [BOARD DEVICE]]]
 *
 * Without a board it is an emulated one behind libusb, port and board in this process, so that this
 * measures the host: libusb, the protocol, the simulated rig; a real bus adds its frames (125 us
 * each way at high speed).
 */
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "mechkit/board.h"
#include "mechkit/clock.h"

static int by_size(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double cpu_s(void)
{
    struct rusage r;
    getrusage(RUSAGE_SELF, &r);
    return (double)(r.ru_utime.tv_sec + r.ru_stime.tv_sec) +
           1e-6 * (double)(r.ru_utime.tv_usec + r.ru_stime.tv_usec);
}

/* Returns how many exchanges failed or were skipped by the board's own count. */
static size_t measure(struct mk_board *board, double rate_hz, size_t n, double *us)
{
    struct mk_clock *clock = board->clock;
    struct mk_board_sample s = {0};
    int64_t start_ns = mk_clock_now_ns(clock) + 1000000;
    size_t lost = 0;
    uint32_t before = 0;
    for (size_t k = 0; k < n; k++) {
        mk_clock_sleep_until(clock, start_ns + (int64_t)((double)k * 1e9 / rate_hz));
        int64_t t_ns = mk_clock_now_ns(clock);
        if (mk_board_exchange(board, 0.5, &s) != MK_OK || (k > 0 && s.sequence != before + 1))
            lost++;
        before = s.sequence;
        us[k] = 1e-3 * (double)(mk_clock_now_ns(clock) - t_ns);
    }
    return lost;
}

int main(int argc, char **argv)
{
    double seconds = argc > 1 ? atof(argv[1]) : 60.0, rate_hz = argc > 2 ? atof(argv[2]) : 1000.0;
    const char *name = argc > 3 ? argv[3] : "usb", *device = argc > 4 ? argv[4] : NULL;
    size_t n = (size_t)(seconds * rate_hz);
    double *us = calloc(n + 1, sizeof *us);
    struct mk_model model;
    struct mk_clock clock;
    struct mk_board *board;
    struct mk_error err = MK_ERROR_INIT;
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    mk_clock_init_monotonic(&clock);
    const struct mk_board_config config = {.model = &model, .clock = &clock, .device = device};
    if (!us || n < 1 ||
        mk_board_open(mk_board_backend_by_name(name), &config, &board, &err) != MK_OK ||
        board->ops->set_watchdog(board, 0, &err) != MK_OK) {
        fprintf(stderr, "roundtrip: %s\n", err.message);
        return 1;
    }
    const struct sched_param priority = {.sched_priority = 80};
    bool fifo = sched_setscheduler(0, SCHED_FIFO, &priority) == 0;
    double cpu = cpu_s();
    size_t lost = measure(board, rate_hz, n, us);
    cpu = cpu_s() - cpu;
    mk_board_close(board);
    qsort(us, n, sizeof *us, by_size);
    printf("%zu exchanges at %g Hz through %s: p50 %.1f us, p99 %.1f us, p99.9 %.1f us, max %.1f "
           "us; %zu lost; host CPU %.1f %% of a core; %s\n",
           n, rate_hz, argc > 3 ? name : "libusb", us[n / 2], us[n * 99 / 100], us[n * 999 / 1000],
           us[n - 1], lost, 100.0 * cpu * rate_hz / (double)n,
           fifo ? "SCHED_FIFO" : "no real-time priority");
    free(us);
    return lost > 0;
}

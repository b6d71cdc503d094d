/* A rig, a board and a loop with a controller that does what a test wants. */
#ifndef MECHKIT_TESTS_BENCH_H
#define MECHKIT_TESTS_BENCH_H

#include "mechkit/loop.h"

struct bench {
    struct mk_model model;
    struct mk_clock clock;
    struct mk_board *board;
    struct mk_ctrl ctrl;
    struct mk_loop_config config;
    struct mk_board_config board_config;
    struct mk_loop *loop;
    struct mk_board_ops ops; /* between loop and board, by bench_override_board() */
    const struct mk_board_ops *own;
    double told_s; /* sum of the time steps that the law was told */
    char path[64];
};
extern struct bench bench;

/* Parameters of the test's law: u = bias * scale, the bias from the signal where there is one; no
 * number from tick break_at on; phase balance from tick 100 to fall_at, ref = tick. */
enum { BIAS, SCALE, BREAK_AT, FALL_AT, PARAM_COUNT };

/* Check fixtures: a pendubot in simulated time, nothing built yet, a temporary file at bench.path.
 */
void bench_setup(void);
void bench_teardown(void);

/* Before building. */
void bench_use_plant(enum mk_plant_kind kind);
void bench_use_real_time(double rate_hz);

/* Board, controller and loop; `faults` is a fault script or NULL. The law gives u = 0, or `u`. */
void bench_build(const char *faults);
void bench_build_driving(const char *faults, double u);
void bench_build_on(const char *backend);
void bench_drop_loop(void);

/* These fail the test when they do not succeed. */
void bench_start(void); /* logs to bench.path */
void bench_set_law(double bias, double scale, double break_at);
void bench_halt(void);
struct mk_log *bench_read_log(void);
size_t bench_rows_logged(void);
/* Start, so long a run and halt in one; the second returns what was logged of it. */
void bench_run(double seconds);
struct mk_log *bench_log_of_run(double seconds);
/* Starts a run that this fault ends in time. It is not halted. */
void bench_run_into(enum mk_fault fault, double within_s);

enum mk_status bench_wait_for(double seconds);
struct mk_loop_snapshot bench_look(void);

/* The functions of the board, for a test to put its own in the place of some; those reach the
 * board's by bench.own. Until bench_restore_board(). */
struct mk_board_ops *bench_override_board(void);
void bench_restore_board(void);

/* The plant's own word: for 0.1 s it moves as a plant does that nothing drives. */
void bench_assert_motor_is_off(void);

#endif

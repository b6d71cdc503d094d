/* A wheel with an emulated board at the far end of a line (emu/bench.h), and the host that comes to
 * it: in simulated time where a test says nothing else. */
#ifndef MECHKIT_TESTS_SUPPORT_REMOTE_H
#define MECHKIT_TESTS_SUPPORT_REMOTE_H

#include "emu/bench.h"

struct remote {
    struct mk_error err; /* what the host was told last */
    struct mk_model model;
    struct mk_clock clock;
    struct emu_bench bench; /* the far side: what the board was told, what the motor does */
    struct mk_board *board; /* as the host has it open, or NULL */
};
extern struct remote remote;

/* Check fixtures: nothing is plugged in yet. */
void remote_setup(void);
void remote_teardown(void);

/* A board at the far end of a line, named as emu_bench_init() takes it. */
void remote_plug_in(const char *line);
/* The host opens it in simulated time. */
enum mk_status remote_open(void);
struct mk_board_config remote_config(void); /* what it is opened with */
/* As `mechkit` does with --board NAME --device DEVICE, in real time. */
enum mk_status remote_try_open(const char *name, const char *device);
/* Plugged in and open, or the test fails. */
void remote_sit_at(const char *line);
void remote_close(void);

/* Fails the test when `st` is no success. */
void remote_must(enum mk_status st);
/* Fails it when the last error does not say `text`. */
void remote_says(const char *text);

#endif

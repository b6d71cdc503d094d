/* The program and its neighbours as a test runs them. */
#ifndef MECHKIT_TESTS_SUPPORT_PROGRAM_H
#define MECHKIT_TESTS_SUPPORT_PROGRAM_H

#include <stdbool.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Runs `mechkit ARGS`; standard output and error go to `out` (may be NULL). Returns the exit code.
 */
int run_mechkit(char *out, size_t size, const char *fmt, ...) __attribute__((format(printf, 3, 4)));
/* The same for any shell command. */
int run_command(char *out, size_t size, const char *fmt, ...) __attribute__((format(printf, 3, 4)));

/* Log of an open-loop run of a rig on the virtual board, in simulated time: models/RIG.ini driven
 * by a signal expression. Fails the test when the run does. Path in static storage (scratch). */
const char *open_loop_log(const char *rig, const char *signal, double seconds);

/* A folder beside the source tree with measured logs (shared/data/NAME) or NULL; MECHKIT_SHARED
 * names another place than ../shared. Static storage. */
const char *shared_path(const char *name);

/* A log that others measured, data/FOLDER/RUN.csv there, taken in by models/measured/MAP.map; NULL
 * where it is not there, which is said on standard error. The caller frees it. */
struct mk_log *measured_log(const char *folder, const char *run, const char *map);

/* Whether a program is on the path; says once, on standard error, that `test` skips what needs it
 * when it is not. */
bool have_program(const char *program, const char *test);

#ifdef __cplusplus
}
#endif
#endif

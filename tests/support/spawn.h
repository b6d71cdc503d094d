/* The program started with arguments, as a shell would, its two outputs kept apart. */
#ifndef MECHKIT_TESTS_SUPPORT_SPAWN_H
#define MECHKIT_TESTS_SUPPORT_SPAWN_H

#include <sys/types.h>

struct outcome {
    int code; /* exit code; below 0: the signal that ended it, negated */
    char out[8192], err[8192];
};

/* Starts the program; argv[0] is its name, NULL ends the list. Outputs go to the files `out` and
 * `err`. */
pid_t spawn(const char *const *argv, const char *out, const char *err);
/* Waits for its end, and reads what it wrote. */
struct outcome finish(pid_t child, const char *out, const char *err);
/* Both, with files of the test. */
struct outcome mechkit(const char *const *argv);

#define MECHKIT(...) mechkit((const char *const[]){"mechkit", __VA_ARGS__, NULL})

#endif

/* The time that passes in the laboratory, for tests of what must not take long. */
#ifndef MECHKIT_TESTS_SUPPORT_WALL_H
#define MECHKIT_TESTS_SUPPORT_WALL_H

/* Seconds since some moment, never backwards. */
double wall_s(void);

#endif

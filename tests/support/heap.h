/* Counts heap allocations of the calling thread, for tests of code that must not make any. */
#ifndef MECHKIT_TESTS_HEAP_H
#define MECHKIT_TESTS_HEAP_H

#include <stdbool.h>

/* False under sanitizers and other C libraries, which keep malloc for themselves. */
bool heap_is_counted(void);
unsigned long heap_allocations(void);

#endif

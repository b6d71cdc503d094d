/* The test program's own malloc in front of glibc's. */
#include "support/heap.h"

#include <stddef.h>
#include <stdlib.h>

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *old, size_t size);

static __thread unsigned long allocations;

void *malloc(size_t size)
{
    allocations++;
    return __libc_malloc(size);
}

void *calloc(size_t count, size_t size)
{
    allocations++;
    return __libc_calloc(count, size);
}

void *realloc(void *old, size_t size)
{
    allocations++;
    return __libc_realloc(old, size);
}

bool heap_is_counted(void)
{
    return true;
}

unsigned long heap_allocations(void)
{
    return allocations;
}

#else

bool heap_is_counted(void)
{
    return false;
}

unsigned long heap_allocations(void)
{
    return 0;
}

#endif

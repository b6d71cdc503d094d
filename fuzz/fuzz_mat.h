/* The bytes of a fuzzer as a MAT file that is whole. */
#ifndef MECHKIT_FUZZ_MAT_H
#define MECHKIT_FUZZ_MAT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Writes variables of any class, size and nesting, as the bytes say. False: matio would not. */
bool fuzz_mat(const char *path, const uint8_t *data, size_t size);

#endif

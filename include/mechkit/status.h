/* Status codes and error details of every mechkit module.
 *
 * A function that can fail returns enum mk_status: MK_OK (0) or a negative code; where a header
 * says so, a positive value is a count. The code tells what class of thing went wrong; struct
 * mk_error tells a person where and what would be right. The library never prints and never exits.
 *
 * Threads: everything here is re-entrant. Not for the real-time path, except mk_status_name() and
 * mk_strerror(), which return static text.
 */
#ifndef MECHKIT_STATUS_H
#define MECHKIT_STATUS_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

/* One list gives the enumerator, its name and its text. Codes are part of the ABI: append only. */
#define MK_STATUS_LIST(X)                                                                          \
    X(OK, 0, "success")                                                                            \
    X(ERR_NOMEM, -1, "out of memory")                                                              \
    X(ERR_INVALID, -2, "invalid argument")                                                         \
    X(ERR_IO, -3, "input/output error")                                                            \
    X(ERR_PARSE, -4, "malformed input")                                                            \
    X(ERR_RANGE, -5, "value out of range")                                                         \
    X(ERR_NOTFOUND, -6, "not found")                                                               \
    X(ERR_NOTSUP, -7, "not supported")                                                             \
    X(ERR_TIMEOUT, -8, "timed out")                                                                \
    X(ERR_NODEV, -9, "device disconnected")                                                        \
    X(ERR_BUSY, -10, "device or resource busy")                                                    \
    X(ERR_PERM, -11, "permission denied")                                                          \
    X(ERR_PROTO, -12, "protocol error")                                                            \
    X(ERR_FAULT, -13, "safety fault latched")                                                      \
    X(ERR_STATE, -14, "not possible in this state")                                                \
    X(ERR_NUMERIC, -15, "numerical failure")                                                       \
    X(ERR_NOSPACE, -16, "no space left")                                                           \
    X(ERR_INTR, -17, "interrupted")                                                                \
    X(ERR_EXPECT, -18, "expectation not met")                                                      \
    X(ERR_USAGE, -19, "wrong usage")

enum mk_status {
#define MK_STATUS_ENUM(name, code, text) MK_##name = (code),
    MK_STATUS_LIST(MK_STATUS_ENUM)
#undef MK_STATUS_ENUM
};

#define MK_NODISCARD __attribute__((warn_unused_result))
#define MK_PRINTF(fmt, args) __attribute__((format(printf, fmt, args)))

/* Where and why something failed. Plain memory, no ownership: put it on the stack with
 * MK_ERROR_INIT and pass its address, or pass NULL when only the code matters. */
struct mk_error {
    enum mk_status status; /* MK_OK: nothing was reported */
    int line;              /* 1-based line in `file`; 0: no line */
    int column;            /* 1-based character (text) or field (table); 0: no column */
    int os_code;           /* errno, libusb or SUNDIALS number that caused it; 0: none */
    char file[256];        /* path as the user gave it; "" : no file */
    char message[512];     /* what is wrong and what would be right; no trailing newline */
};

#define MK_ERROR_INIT                                                                              \
    {                                                                                              \
        MK_OK, 0, 0, 0, "", ""                                                                     \
    }

/* Name of the enumerator, e.g. "MK_ERR_PARSE"; "MK_ERR_?" for a number that is no code. Static. */
const char *mk_status_name(enum mk_status status);

/* One-line English text, e.g. "malformed input". Static, never NULL. */
const char *mk_strerror(enum mk_status status);

/* Fills *err (NULL allowed: ignored) and returns `status`, so that a caller can write
 * `return mk_error_set(err, MK_ERR_RANGE, "...")`. The location fields are cleared. */
enum mk_status mk_error_set(struct mk_error *err, enum mk_status status, const char *fmt, ...)
    MK_PRINTF(3, 4);

/* As mk_error_set, with a location. `file` may be NULL; line and column 0 mean "none". */
enum mk_status mk_error_at(struct mk_error *err, enum mk_status status, const char *file, int line,
                           int column, const char *fmt, ...) MK_PRINTF(6, 7);

/* As mk_error_set for a failed system call: maps `os_errno` to a code (ENOSPC and EFBIG to
 * MK_ERR_NOSPACE, EACCES and EPERM to MK_ERR_PERM, ENOENT to MK_ERR_NOTFOUND, EBUSY, ENODEV,
 * ETIMEDOUT, ENOMEM, EINTR to theirs, the rest to MK_ERR_IO) and appends its text. */
enum mk_status mk_error_errno(struct mk_error *err, int os_errno, const char *file, const char *fmt,
                              ...) MK_PRINTF(4, 5);

/* "FILE:LINE:COLUMN: message", leaving out what is not known. Returns buf. */
char *mk_error_format(const struct mk_error *err, char *buf, size_t size);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif

#include "mechkit/status.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

const char *mk_status_name(enum mk_status status)
{
    switch (status) {
#define MK_STATUS_NAME(name, code, text)                                                           \
    case MK_##name:                                                                                \
        return "MK_" #name;
        MK_STATUS_LIST(MK_STATUS_NAME)
#undef MK_STATUS_NAME
    }
    return "MK_ERR_?";
}

const char *mk_strerror(enum mk_status status)
{
    switch (status) {
#define MK_STATUS_TEXT(name, code, text)                                                           \
    case MK_##name:                                                                                \
        return text;
        MK_STATUS_LIST(MK_STATUS_TEXT)
#undef MK_STATUS_TEXT
    }
    return "unknown status";
}

static void fill(struct mk_error *err, enum mk_status status, const char *file, int line,
                 int column, const char *fmt, va_list args)
{
    err->status = status;
    err->line = line;
    err->column = column;
    err->os_code = 0;
    snprintf(err->file, sizeof err->file, "%s", file ? file : "");
    vsnprintf(err->message, sizeof err->message, fmt, args);
}

enum mk_status mk_error_set(struct mk_error *err, enum mk_status status, const char *fmt, ...)
{
    if (!err)
        return status;
    va_list args;
    va_start(args, fmt);
    fill(err, status, NULL, 0, 0, fmt, args);
    va_end(args);
    return status;
}

enum mk_status mk_error_at(struct mk_error *err, enum mk_status status, const char *file, int line,
                           int column, const char *fmt, ...)
{
    if (!err)
        return status;
    va_list args;
    va_start(args, fmt);
    fill(err, status, file, line, column, fmt, args);
    va_end(args);
    return status;
}

static enum mk_status from_errno(int os_errno)
{
    switch (os_errno) {
    case ENOSPC:
    case EFBIG:
    case EDQUOT:
        return MK_ERR_NOSPACE;
    case EACCES:
    case EPERM:
    case EROFS:
        return MK_ERR_PERM;
    case ENOENT:
        return MK_ERR_NOTFOUND;
    case EBUSY:
        return MK_ERR_BUSY;
    case ENODEV:
        return MK_ERR_NODEV;
    case ETIMEDOUT:
        return MK_ERR_TIMEOUT;
    case ENOMEM:
        return MK_ERR_NOMEM;
    case EINTR:
        return MK_ERR_INTR;
    default:
        return MK_ERR_IO;
    }
}

enum mk_status mk_error_errno(struct mk_error *err, int os_errno, const char *file, const char *fmt,
                              ...)
{
    enum mk_status status = from_errno(os_errno);
    if (!err)
        return status;
    va_list args;
    va_start(args, fmt);
    fill(err, status, file, 0, 0, fmt, args);
    va_end(args);
    err->os_code = os_errno;
    size_t used = strlen(err->message);
    snprintf(err->message + used, sizeof err->message - used, ": %s", strerror(os_errno));
    return status;
}

char *mk_error_format(const struct mk_error *err, char *buf, size_t size)
{
    char where[320] = "";
    if (err->file[0]) {
        int n = snprintf(where, sizeof where, "%s:", err->file);
        if (err->line > 0 && n > 0 && (size_t)n < sizeof where)
            n += snprintf(where + n, sizeof where - (size_t)n, "%d:", err->line);
        if (err->line > 0 && err->column > 0 && n > 0 && (size_t)n < sizeof where)
            n += snprintf(where + n, sizeof where - (size_t)n, "%d:", err->column);
        if (n > 0 && (size_t)n < sizeof where - 1)
            strcpy(where + n, " ");
    }
    snprintf(buf, size, "%s%s", where, err->message[0] ? err->message : mk_strerror(err->status));
    return buf;
}

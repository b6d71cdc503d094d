/* ZIP archives, as far as writing whole small files takes: deflated, no encryption, below 4 GB. */
#ifndef MECHKIT_BASE_ZIP_H
#define MECHKIT_BASE_ZIP_H

#include <stddef.h>

#include "mechkit/status.h"

#ifdef __cplusplus
extern "C" {
#endif

struct mk_zip_entry {
    const char *name; /* path inside, with / */
    const char *data;
    size_t size;
};

/* Writes an archive, atomically. MK_ERR_NOMEM, MK_ERR_RANGE (too large), and what writing a file
 * gives. The same entries give the same bytes: entries carry no time. */
MK_NODISCARD enum mk_status mk_zip_write(const char *path, const struct mk_zip_entry *entries,
                                         size_t count, struct mk_error *err);

#ifdef __cplusplus
}
#endif
#endif

#include "investigate/salvage.h"

#include <errno.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/origin.h"
#include "mechkit/log.h"

enum mk_status salvage_log(struct experiment *x, const char *path, bool *found,
                           struct mk_error *err)
{
    struct stat info;
    struct mk_log *log = NULL;
    *found = false;
    if (stat(path, &info) != 0)
        return MK_OK;
    const double *t =
        mk_log_read(path, &log, NULL) == MK_OK && log->rows > 0 ? mk_log_get(log, "t") : NULL;
    if (t) {
        const double ran = t[log->rows - 1] - t[0];
        x->ran_s = ran;
        x->broken_off = ran < 0.99 * x->seconds - 0.1;
        mk_log_free(log);
        *found = true;
        snprintf(x->fault, sizeof x->fault, "%s",
                 x->broken_off ? "broken off: the program ended while it ran" : "");
        (void)mk_date_text(x->run_at);
        return MK_OK;
    }
    mk_log_free(log);
    /* Not a row: nothing was run. It stays under another name. */
    char aside[JOURNAL_PATH + 32];
    for (int i = 1; i < 100; i++) {
        snprintf(aside, sizeof aside, "%s.empty-%d", path, i);
        if (access(aside, F_OK) != 0)
            return rename(path, aside) == 0
                       ? MK_OK
                       : mk_error_errno(err, errno, path, "cannot put an empty log aside");
    }
    return mk_error_at(err, MK_ERR_STATE, path, 0, 0, "too many empty logs beside this one");
}

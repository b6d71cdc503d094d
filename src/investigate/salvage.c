#include "investigate/salvage.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "investigate/runs.h"
#include "mechkit/log.h"

/* Whether what the log says to have ended its run was the board, not the rig. */
static bool ended_by_the_board(const char *fault)
{
    for (int f = 0; f < MK_FAULT_COUNT; f++) {
        const char *name = mk_fault_name((enum mk_fault)f);
        const size_t n = strlen(name);
        if (strncmp(fault, name, n) == 0 && fault[n] == ' ')
            return rig_fault_is_of_the_board((enum mk_fault)f);
    }
    return true;
}

/* `fault`: of the log; NULL: none. */
static void say_how_it_ended(struct experiment *x, const char *fault)
{
    const bool early = x->ran_s < 0.99 * x->seconds - 0.1;
    x->broken_off = fault ? ended_by_the_board(fault) : early;
    snprintf(x->fault, sizeof x->fault, "%s",
             fault   ? fault
             : early ? "broken off: the program ended while it ran"
                     : "");
}

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
        x->ran_s = t[log->rows - 1] - t[0];
        say_how_it_ended(x, mk_log_find_meta(log, "fault"));
        mk_log_free(log);
        *found = true;
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

#include "support/program.h"

#include <check.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "mechkit/log.h"
#include "support/files.h"

static int run(char *out, size_t size, const char *command)
{
    FILE *f = popen(command, "r");
    ck_assert_ptr_nonnull(f);
    char local[16384];
    size_t n = fread(local, 1, sizeof local - 1, f);
    local[n] = 0;
    char rest[4096];
    while (fread(rest, 1, sizeof rest, f) > 0)
        continue; /* the writer must not be stopped by a full pipe */
    if (out)
        snprintf(out, size, "%s", local);
    int status = pclose(f);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

int run_command(char *out, size_t size, const char *fmt, ...)
{
    char command[4096];
    va_list args;
    va_start(args, fmt);
    int n = vsnprintf(command, sizeof command - 8, fmt, args);
    va_end(args);
    ck_assert_int_lt(n, (int)sizeof command - 8);
    strcat(command, " 2>&1");
    return run(out, size, command);
}

int run_mechkit(char *out, size_t size, const char *fmt, ...)
{
    char command[4096];
    int head = snprintf(command, sizeof command, "%s ", MK_TEST_APP);
    va_list args;
    va_start(args, fmt);
    int n = vsnprintf(command + head, sizeof command - 8 - (size_t)head, fmt, args);
    va_end(args);
    ck_assert_int_lt(head + n, (int)sizeof command - 8);
    strcat(command, " 2>&1");
    return run(out, size, command);
}

const char *open_loop_log(const char *rig, const char *signal, double seconds)
{
    char text[512], name[64], folder[256], out[4096];
    snprintf(text, sizeof text,
             "model %s/models/%s.ini\nsetup open-loop\ninput %s\nstart\nwait %g\nhalt\n"
             "save %s.csv\nquit\n",
             MK_SOURCE_DIR, rig, signal, seconds, rig);
    snprintf(name, sizeof name, "%s.csv", rig);
    const char *path = scratch(name);
    unlink(path);
    snprintf(folder, sizeof folder, "%s", path);
    *strrchr(folder, '/') = 0;
    const char *script = scratch_text("open_loop.cmd", text);
    int code = run_mechkit(out, sizeof out, "run %s --fast --quiet --out %s", script, folder);
    ck_assert_msg(code == 0, "%s: %s", rig, out);
    return path;
}

const char *shared_path(const char *name)
{
    static char path[1024];
    const char *base = getenv("MECHKIT_SHARED");
    if (base)
        snprintf(path, sizeof path, "%s/%s", base, name);
    else
        snprintf(path, sizeof path, "%s/../shared/%s", MK_SOURCE_DIR, name);
    return access(path, R_OK) == 0 ? path : NULL;
}

struct mk_log *measured_log(const char *folder, const char *run, const char *map)
{
    char name[256], said[4096], csv[512];
    snprintf(name, sizeof name, "data/%s/%s.csv", folder, run);
    const char *path = shared_path(name);
    if (!path) {
        fprintf(stderr, "skipped: no measured log %s/%s\n", folder, run);
        return NULL;
    }
    snprintf(name, sizeof name, "%s.csv", run);
    snprintf(csv, sizeof csv, "%s", scratch(name));
    ck_assert_msg(run_mechkit(said, sizeof said, "import %s --map models/measured/%s.map --out %s",
                              path, map, csv) == 0,
                  "%s", said);
    struct mk_log *log = NULL;
    struct mk_error err = MK_ERROR_INIT;
    ck_assert_msg(mk_log_read(csv, &log, &err) == MK_OK, "%s", err.message);
    return log;
}

bool have_program(const char *program, const char *test)
{
    char out[256];
    if (run_command(out, sizeof out, "command -v %s", program) == 0)
        return true;
    fprintf(stderr, "%s: skipped, %s is not installed\n", test, program);
    return false;
}

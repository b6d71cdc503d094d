#include "support/files.h"

#include <dirent.h>
#include <ftw.h>
#include <glob.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

static char directory[64];
static pid_t owner;

static int remove_one(const char *path, const struct stat *s, int kind, struct FTW *f)
{
    (void)s, (void)kind, (void)f;
    return remove(path);
}

static void clean_up(void)
{
    if (owner == getpid())
        nftw(directory, remove_one, 8, FTW_DEPTH | FTW_PHYS);
}

const char *scratch(const char *name)
{
    static char paths[64][256];
    static int turn;
    if (owner != getpid()) {
        snprintf(directory, sizeof directory, "/tmp/mechkit-test-XXXXXX");
        if (!mkdtemp(directory))
            abort();
        owner = getpid();
        atexit(clean_up);
    }
    char *path = paths[turn++ % 64];
    snprintf(path, sizeof paths[0], "%s/%s", directory, name);
    return path;
}

const char *scratch_text(const char *name, const char *text)
{
    const char *path = scratch(name);
    FILE *f = fopen(path, "w");
    if (!f || fputs(text, f) < 0 || fclose(f) != 0)
        abort();
    return path;
}

void limit_file_size(unsigned long bytes)
{
    struct rlimit limit;
    signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &limit);
    limit.rlim_cur = bytes ? bytes : limit.rlim_max;
    setrlimit(RLIMIT_FSIZE, &limit);
}

int count_files(const char *pattern)
{
    glob_t found;
    int count = glob(scratch(pattern), 0, NULL, &found) == 0 ? (int)found.gl_pathc : 0;
    globfree(&found);
    return count;
}

int open_files(void)
{
    DIR *all = opendir("/proc/self/fd");
    int n = 0;
    while (all && readdir(all))
        n++;
    if (all)
        closedir(all);
    return n;
}

char *slurp_file(const char *path)
{
    FILE *f = fopen(path, "rb");
    if (!f)
        return NULL;
    fseek(f, 0, SEEK_END);
    long n = ftell(f);
    rewind(f);
    char *text = calloc(1, (size_t)n + 1);
    if (text && fread(text, 1, (size_t)n, f) != (size_t)n)
        abort();
    fclose(f);
    return text;
}

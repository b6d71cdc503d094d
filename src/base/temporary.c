#include "base/temporary.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

/* --- the list -------------------------------------------------------------------------------- */

/* More than any command writes at a time. */
#define LISTED_MOST 64

/* A handler of signals may come between any two instructions, in any thread: whoever exchanges a
 * place for NULL has the path. */
static _Atomic(const char *) listed[LISTED_MOST];

void mk_temporary_add(const char *path)
{
    for (int i = 0; path && i < LISTED_MOST; i++) {
        const char *none = NULL;
        if (atomic_compare_exchange_strong(&listed[i], &none, path))
            return;
    }
}

static atomic_bool removing;

void mk_temporary_done(char *path)
{
    bool found = false;
    for (int i = 0; path && !found && i < LISTED_MOST; i++) {
        const char *mine = path;
        found = atomic_compare_exchange_strong(&listed[i], &mine, NULL);
    }
    while (path && !found && atomic_load(&removing))
        pause(); /* the handler still reads the path, and the program ends */
    free(path);
}

void mk_temporary_remove(void)
{
    const char *path[LISTED_MOST];
    const int before = errno;
    atomic_store(&removing, true);
    for (int i = 0; i < LISTED_MOST; i++) {
        path[i] = atomic_exchange(&listed[i], NULL);
        if (path[i] && unlink(path[i]) == 0)
            path[i] = NULL;
    }
    for (int i = 0; i < LISTED_MOST; i++) /* folders, which are empty now */
        if (path[i])
            (void)rmdir(path[i]);
    errno = before;
}

/* --- what a killed program left ------------------------------------------------------------- */

/* "base.PID-WHATEVER.tmp": the process that made it, 0 when it is another file. */
static pid_t maker_of(const char *name, const char *base)
{
    size_t n = strlen(base), size = strlen(name);
    char *end;
    if (size < n + 7 || strncmp(name, base, n) != 0 || name[n] != '.' || name[n + 1] < '1' ||
        name[n + 1] > '9' || strcmp(name + size - 4, ".tmp") != 0)
        return 0;
    long pid = strtol(name + n + 1, &end, 10);
    return *end == '-' && pid > 0 && pid < INT_MAX ? (pid_t)pid : 0;
}

/* Opens what a dead process left. A process elsewhere that shares the folder is none of ours: it
 * holds a lock. -1: it is another's, or not of the kind `type`. */
static int open_left(int folder, const char *name, mode_t type)
{
    struct stat info;
    int fd = openat(folder, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0)
        return -1;
    if (fstat(fd, &info) == 0 && (info.st_mode & S_IFMT) == type &&
        (type != S_IFDIR || info.st_uid == geteuid()) && flock(fd, LOCK_EX | LOCK_NB) == 0)
        return fd;
    close(fd);
    return -1;
}

static void remove_file_if_left(int folder, const char *name)
{
    int fd = open_left(folder, name, S_IFREG);
    if (fd < 0)
        return;
    unlinkat(folder, name, 0);
    close(fd);
}

/* Removes what is in an open folder, and closes it. */
static void empty(int folder)
{
    DIR *all = fdopendir(folder);
    if (!all) {
        close(folder);
        return;
    }
    for (struct dirent *one; (one = readdir(all)) != NULL;)
        (void)unlinkat(dirfd(all), one->d_name, 0); /* of "." and "..": refused */
    closedir(all);
}

static void remove_folder_if_left(int folder, const char *name)
{
    int fd = open_left(folder, name, S_IFDIR);
    if (fd < 0)
        return;
    empty(fd);
    (void)unlinkat(folder, name, AT_REMOVEDIR);
}

static void clean(const char *target, void (*remove_if_left)(int folder, const char *name))
{
    const char *slash = strrchr(target, '/'), *base = slash ? slash + 1 : target;
    char *folder = slash ? strndup(target, (size_t)(base - target)) : strdup(".");
    DIR *all = folder ? opendir(folder) : NULL;
    for (struct dirent *one; all && (one = readdir(all)) != NULL;) {
        pid_t maker = maker_of(one->d_name, base);
        if (maker && kill(maker, 0) != 0 && errno == ESRCH)
            remove_if_left(dirfd(all), one->d_name);
    }
    if (all)
        closedir(all);
    free(folder);
}

void mk_temporary_clean(const char *target)
{
    clean(target, remove_file_if_left);
}

/* --- folders -------------------------------------------------------------------------------- */

/* mkdir(2) finds a name that is free, and follows no link that somebody put there. 0 or errno. */
static int make_folder(char *path, size_t size, const char *target)
{
    int failure = EEXIST;
    for (unsigned attempt = 0; failure == EEXIST && attempt < 1000; attempt++) {
        snprintf(path, size, "%s.%ld-%u.tmp", target, (long)getpid(), attempt);
        failure = mkdir(path, 0700) == 0 ? 0 : errno;
    }
    return failure;
}

enum mk_status mk_temporary_folder_open(struct mk_temporary_folder *folder, const char *where,
                                        const char *name, struct mk_error *err)
{
    const char *base = where ? where : getenv("TMPDIR");
    char target[PATH_MAX];
    *folder = (struct mk_temporary_folder){.lock = -1};
    if (!base || !*base)
        base = "/tmp";
    int n = snprintf(target, sizeof target, "%s/%s", base, name);
    if ((size_t)n >= sizeof target)
        return mk_error_errno(err, ENAMETOOLONG, base, "cannot make a temporary folder here");
    const size_t size = (size_t)n + 48;
    folder->path = malloc(size);
    if (!folder->path)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", target);
    clean(target, remove_folder_if_left);
    const int failure = make_folder(folder->path, size, target);
    if (failure) {
        free(folder->path);
        folder->path = NULL;
        return mk_error_errno(err, failure, base, "cannot make a temporary folder here");
    }
    mk_temporary_add(folder->path);
    folder->lock = open(folder->path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder->lock >= 0)
        (void)!flock(folder->lock, LOCK_EX | LOCK_NB); /* where the file system has locks */
    return MK_OK;
}

void mk_temporary_folder_close(struct mk_temporary_folder *folder)
{
    if (folder->lock >= 0)
        empty(folder->lock);
    (void)rmdir(folder->path);
    mk_temporary_done(folder->path);
}

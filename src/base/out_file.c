#include "base/out_file.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/temporary.h"

#define LINKS_MAX 40 /* one to the next, as the kernel follows them */

int mk_write_all(int fd, const char *data, size_t size, size_t *written)
{
    size_t done = 0;
    int failure = 0;
    while (done < size && failure == 0) {
        ssize_t n = write(fd, data + done, size - done);
        if (n >= 0)
            done += (size_t)n;
        else if (errno != EINTR)
            failure = errno;
    }
    if (written)
        *written = done;
    return failure;
}

int mk_sync(int fd)
{
    while (fsync(fd) != 0) {
        /* Pipes and devices have nothing to bring to a disk. */
        if (errno == EINVAL || errno == EROFS || errno == ENOTSUP)
            return 0;
        if (errno != EINTR)
            return errno;
    }
    return 0;
}

int mk_close_written(int fd, int failure)
{
    /* Interrupted, it is closed all the same. */
    const int unclosed = close(fd) == 0 || errno == EINTR ? 0 : errno;
    return failure ? failure : unclosed;
}

/* What is left to read of `from`, to `to`. 0 or errno. */
static int copy_rest(int from, int to)
{
    char block[1 << 14];
    for (;;) {
        const ssize_t n = read(from, block, sizeof block);
        if (n == 0)
            return 0;
        if (n < 0 && errno != EINTR)
            return errno;
        const int failure = n > 0 ? mk_write_all(to, block, (size_t)n, NULL) : 0;
        if (failure)
            return failure;
    }
}

int mk_copy_new(const char *from, const char *to)
{
    const int from_fd = open(from, O_RDONLY | O_CLOEXEC);
    if (from_fd < 0)
        return errno;
    const int to_fd = open(to, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    int failure = errno;
    if (to_fd >= 0) {
        failure = copy_rest(from_fd, to_fd);
        if (failure == 0)
            failure = mk_sync(to_fd);
        failure = mk_close_written(to_fd, failure);
        if (failure)
            unlink(to);
    }
    close(from_fd);
    return failure;
}

/* A new file beside the target; O_EXCL finds a name that is free. */
static int open_temporary(struct mk_out_file *file, mode_t mode)
{
    size_t size = strlen(file->target) + 48;
    file->temporary = malloc(size);
    if (!file->temporary)
        return ENOMEM;
    mk_temporary_clean(file->target);
    for (unsigned attempt = 0; attempt < 1000; attempt++) {
        snprintf(file->temporary, size, "%s.%ld-%u.tmp", file->target, (long)getpid(), attempt);
        file->fd = open(file->temporary, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
        if (file->fd >= 0) {
            mk_temporary_add(file->temporary);
            (void)!flock(file->fd, LOCK_EX | LOCK_NB); /* where the file system has locks */
            return 0;
        }
        if (errno != EEXIST)
            return errno;
    }
    return EEXIST;
}

/* Where a link points to, seen from the link's own folder; NULL with errno where it is none. */
static char *follow_link(const char *link)
{
    char to[PATH_MAX];
    const ssize_t n = readlink(link, to, sizeof to);
    if (n < 0 || n == (ssize_t)sizeof to) {
        errno = n < 0 ? errno : ENAMETOOLONG;
        return NULL;
    }
    const char *slash = strrchr(link, '/');
    const size_t folder = to[0] != '/' && slash ? (size_t)(slash + 1 - link) : 0;
    char *target = malloc(folder + (size_t)n + 1);
    if (target) {
        memcpy(target, link, folder);
        memcpy(target + folder, to, (size_t)n);
        target[folder + (size_t)n] = '\0';
    }
    return target;
}

/* The name that a new file gets: where the path is a link to a file that is not there yet, the
 * link stays and that file is made, as open() would. 0 or errno. */
static int name_new(struct mk_out_file *file)
{
    file->target = strdup(file->path);
    for (int links = 0; file->target; links++) {
        char *next = follow_link(file->target);
        if (!next)
            return errno == EINVAL || errno == ENOENT ? 0 : errno;
        free(file->target);
        file->target = next;
        if (links == LINKS_MAX)
            return ELOOP;
    }
    return ENOMEM;
}

static int open_target(struct mk_out_file *file)
{
    struct stat info;
    bool exists = stat(file->path, &info) == 0;
    if (exists && S_ISDIR(info.st_mode))
        return EISDIR;
    const int unnamed = exists ? 0 : name_new(file);
    if (unnamed)
        return unnamed;
    if (exists)
        file->target = realpath(file->path, NULL);
    if (!file->target)
        return errno;
    if (exists && !S_ISREG(info.st_mode)) {
        file->fd = open(file->target, O_WRONLY | O_CLOEXEC);
        return file->fd < 0 ? errno : 0;
    }
    if (exists && access(file->target, W_OK) != 0)
        return errno;
    int failure = open_temporary(file, 0666);
    if (failure == 0 && exists) /* its permissions stay where they can; not worth failing for */
        (void)!fchmod(file->fd, info.st_mode & 07777);
    return failure;
}

enum mk_status mk_out_file_open(struct mk_out_file *file, const char *path, struct mk_error *err)
{
    *file = (struct mk_out_file){.fd = -1, .path = path};
    int failure = open_target(file);
    if (failure == 0)
        return MK_OK;
    free(file->target);
    mk_temporary_done(file->temporary);
    return mk_error_errno(err, failure, path, "cannot write");
}

enum mk_status mk_out_file_write(struct mk_out_file *file, const char *data, size_t size,
                                 struct mk_error *err)
{
    int failure = mk_write_all(file->fd, data, size, NULL);
    return failure ? mk_error_errno(err, failure, file->path, "cannot write") : MK_OK;
}

enum mk_status mk_out_file_commit(struct mk_out_file *file, struct mk_error *err)
{
    int failure = mk_close_written(file->fd, mk_sync(file->fd));
    file->fd = -1;
    if (failure == 0 && file->temporary && rename(file->temporary, file->target) != 0)
        failure = errno;
    if (failure) {
        mk_out_file_abandon(file);
        return mk_error_errno(err, failure, file->path, "cannot write");
    }
    mk_temporary_done(file->temporary);
    free(file->target);
    return MK_OK;
}

void mk_out_file_abandon(struct mk_out_file *file)
{
    if (file->fd >= 0)
        close(file->fd);
    if (file->temporary)
        unlink(file->temporary);
    mk_temporary_done(file->temporary);
    free(file->target);
}

enum mk_status mk_out_file_finish(struct mk_out_file *file, enum mk_status st, struct mk_error *err)
{
    if (st == MK_OK)
        return mk_out_file_commit(file, err);
    mk_out_file_abandon(file);
    return st;
}

enum mk_status mk_out_file_save(const char *path, const char *data, size_t size,
                                struct mk_error *err)
{
    struct mk_out_file file;
    enum mk_status st = mk_out_file_open(&file, path, err);
    if (st != MK_OK)
        return st;
    return mk_out_file_finish(&file, mk_out_file_write(&file, data, size, err), err);
}

enum mk_status mk_out_file_check(const char *path, struct mk_error *err)
{
    struct mk_out_file file;
    struct stat info;
    if (!path || strcmp(path, "-") == 0 ||
        (stat(path, &info) == 0 && !S_ISREG(info.st_mode) && !S_ISDIR(info.st_mode)))
        return MK_OK;
    enum mk_status st = mk_out_file_open(&file, path, err);
    if (st == MK_OK)
        mk_out_file_abandon(&file);
    return st;
}

enum mk_status mk_out_text_open(struct mk_out_text *out, const char *path, struct mk_error *err)
{
    *out = (struct mk_out_text){.path = path};
    out->stream = open_memstream(&out->text, &out->size);
    return out->stream ? MK_OK : mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
}

enum mk_status mk_out_text_save(struct mk_out_text *out, struct mk_error *err)
{
    bool complete = !ferror(out->stream);
    if (fclose(out->stream) != 0)
        complete = false;
    enum mk_status st = complete ? mk_out_file_save(out->path, out->text, out->size, err)
                                 : mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", out->path);
    free(out->text);
    return st;
}

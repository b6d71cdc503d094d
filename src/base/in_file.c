#include "base/in_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <sys/stat.h>
#include <unistd.h>

int mk_in_file_open(const char *path, const char **other)
{
    struct stat info;
    *other = NULL;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0 || fstat(fd, &info) != 0 || S_ISREG(info.st_mode))
        return fd;
    *other = S_ISDIR(info.st_mode)    ? "it is a folder"
             : S_ISFIFO(info.st_mode) ? "it is a pipe"
                                      : "it is a device";
    close(fd);
    return -1;
}

enum mk_status mk_in_file_check(const char *path, const char *what, struct mk_error *err)
{
    const char *other;
    int fd = mk_in_file_open(path, &other);
    if (fd >= 0) {
        close(fd);
        return MK_OK;
    }
    return other ? mk_error_at(err, MK_ERR_PARSE, path, 0, 0, "cannot read %s: %s, not a file",
                               what, other)
                 : mk_error_errno(err, errno, path, "cannot open %s", what);
}

#include "support/spawn.h"

#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/wait.h>
#include <unistd.h>

#include "support/files.h"

static void drain(int fd, char *text, size_t size)
{
    size_t used = 0;
    ssize_t n;
    while ((n = read(fd, text + used, size - used - 1)) > 0)
        used += (size_t)n;
    text[used] = '\0';
    close(fd);
}

pid_t spawn(const char *const *argv, const char *out, const char *err)
{
    pid_t child = fork();
    if (child == 0) {
        dup2(open(out, O_WRONLY | O_CREAT | O_TRUNC, 0600), 1);
        dup2(open(err, O_WRONLY | O_CREAT | O_TRUNC, 0600), 2);
        execv(MK_TEST_APP, (char *const *)(uintptr_t)argv);
        _exit(99);
    }
    return child;
}

struct outcome finish(pid_t child, const char *out, const char *err)
{
    struct outcome o;
    int status;
    waitpid(child, &status, 0);
    o.code = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
    drain(open(out, O_RDONLY), o.out, sizeof o.out);
    drain(open(err, O_RDONLY), o.err, sizeof o.err);
    return o;
}

struct outcome mechkit(const char *const *argv)
{
    char out[256], err[256];
    snprintf(out, sizeof out, "%s", scratch("stdout"));
    snprintf(err, sizeof err, "%s", scratch("stderr"));
    return finish(spawn(argv, out, err), out, err);
}

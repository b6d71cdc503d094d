/* A MAT file scanned by a child: what it finds comes through a pipe. Both ends are this program, so
 * numbers and names go as they lie in memory: a head, the vectors' heads, their values. A child
 * that dies leaves less than it announced. */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/out_file.h"
#include "exchange/scan_mat.h"

struct head {
    struct mk_error err; /* whose status is that of the scan */
    size_t count;
    char left_out[sizeof((struct mat_scan *)0)->left_out];
};

/* --- the child ------------------------------------------------------------------------------ */

static void send_all(int fd, const struct mat_scan *c, const struct head *head)
{
    int failed = mk_write_all(fd, (const char *)head, sizeof *head, NULL);
    for (size_t i = 0; i < head->count && !failed; i++) {
        const struct mat_vector *v = &c->vector[i];
        failed = mk_write_all(fd, (const char *)v, sizeof *v, NULL);
        if (!failed)
            failed = mk_write_all(fd, (const char *)v->data, v->rows * sizeof *v->data, NULL);
    }
}

/* Signals end it as they end any program; a core file of it helps nobody. */
static void be_silent(void)
{
    const int quiet = open("/dev/null", O_WRONLY | O_CLOEXEC);
    const struct rlimit none = {0, 0};
    signal(SIGINT, SIG_DFL);
    signal(SIGTERM, SIG_DFL);
    signal(SIGPIPE, SIG_DFL);
    setrlimit(RLIMIT_CORE, &none);
    if (quiet >= 0) {
        dup2(quiet, STDOUT_FILENO);
        dup2(quiet, STDERR_FILENO);
    }
}

static _Noreturn void scan_and_send(const char *path, size_t size, int fd)
{
    struct mat_scan c;
    struct head head = {.err = MK_ERROR_INIT};
    be_silent();
    head.count = mat_scan(path, size, &c, &head.err) == MK_OK ? c.count : 0;
    memcpy(head.left_out, c.left_out, sizeof head.left_out);
    send_all(fd, &c, &head);
    _exit(0);
}

/* --- the parent ----------------------------------------------------------------------------- */

static bool receive(int fd, void *to, size_t size)
{
    for (size_t got = 0; got < size;) {
        ssize_t n = read(fd, (char *)to + got, size - got);
        if (n == 0 || (n < 0 && errno != EINTR))
            return false;
        got += n > 0 ? (size_t)n : 0;
    }
    return true;
}

static bool receive_vector(int fd, struct mat_vector *v)
{
    v->data = NULL;
    if (!receive(fd, v, sizeof *v))
        return false;
    v->data = calloc(v->rows, sizeof *v->data);
    return v->data && receive(fd, v->data, v->rows * sizeof *v->data);
}

static enum mk_status receive_all(int fd, const char *path, struct mat_scan *c,
                                  struct mk_error *err)
{
    static const char damaged[] = "damaged: what reads MAT files of version 7.3 broke off";
    struct head head;
    if (!receive(fd, &head, sizeof head))
        return mk_error_at(err, MK_ERR_PARSE, path, 0, 0, damaged);
    if (head.err.status != MK_OK) {
        if (err)
            *err = head.err;
        return head.err.status;
    }
    memcpy(c->left_out, head.left_out, sizeof c->left_out);
    c->vector = calloc(head.count + 1, sizeof *c->vector);
    if (!c->vector)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for %s", path);
    for (c->room = head.count; c->count < head.count; c->count++)
        if (!receive_vector(fd, &c->vector[c->count])) {
            free(c->vector[c->count].data);
            return mk_error_at(err, MK_ERR_PARSE, path, 0, 0, damaged);
        }
    return MK_OK;
}

enum mk_status mat_scan_apart(const char *path, size_t size, struct mat_scan *c,
                              struct mk_error *err)
{
    int end[2];
    *c = (struct mat_scan){0};
    if (pipe2(end, O_CLOEXEC) != 0)
        return mk_error_errno(err, errno, path, "cannot make a pipe to read through");
    pid_t child = fork();
    if (child == 0)
        scan_and_send(path, size, end[1]);
    int failed = child < 0 ? errno : 0;
    close(end[1]);
    enum mk_status st = failed ? mk_error_errno(err, failed, path, "cannot start what reads")
                               : receive_all(end[0], path, c, err);
    close(end[0]);
    while (child > 0 && waitpid(child, NULL, 0) < 0 && errno == EINTR)
        continue;
    return st;
}

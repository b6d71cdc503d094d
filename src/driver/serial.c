#include "driver/serial.h"

#include <errno.h>
#include <fcntl.h>
#include <glob.h>
#include <linux/serial.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/text.h"

#define PATH_SIZE 256

/* Slower ones cannot carry the 64 bytes of an exchange within the 3.5 ms that it may take. */
static const struct {
    unsigned baud;
    speed_t code;
} rates[] = {
    {230400, B230400},   {460800, B460800},   {500000, B500000},   {576000, B576000},
    {921600, B921600},   {1000000, B1000000}, {1152000, B1152000}, {1500000, B1500000},
    {2000000, B2000000}, {2500000, B2500000}, {3000000, B3000000}, {3500000, B3500000},
    {4000000, B4000000},
};
#define RATES (sizeof rates / sizeof rates[0])

static bool code_of(unsigned long baud, speed_t *out)
{
    for (size_t i = 0; i < RATES; i++)
        if (rates[i].baud == baud) {
            *out = rates[i].code;
            return true;
        }
    return false;
}

static enum mk_status wrong_rate(const char *text, struct mk_error *err)
{
    char known[160] = "", shown[64];
    for (size_t i = 0; i < RATES; i++) {
        size_t n = strlen(known);
        snprintf(known + n, sizeof known - n, "%s%u", i ? ", " : "", rates[i].baud);
    }
    mk_show_text(shown, sizeof shown, text);
    return mk_error_set(
        err, MK_ERR_USAGE,
        "'%s' bits per second: an exchange carries 64 bytes within 3.5 ms, which takes "
        "one of %s",
        shown, known);
}

/* --- which port is meant -----------------------------------------------------------------------
 */

/* PATH or PATH,BAUD; a path that is there as it stands may hold a comma. */
static enum mk_status split(const char *device, char path[PATH_SIZE], speed_t *rate,
                            struct mk_error *err)
{
    const char *comma = access(device, F_OK) == 0 ? NULL : strrchr(device, ',');
    size_t n = comma ? (size_t)(comma - device) : strlen(device);
    (void)code_of(MK_SERIAL_BAUD, rate);
    if (n == 0 || n >= PATH_SIZE)
        return mk_error_set(err, MK_ERR_USAGE,
                            "a serial port is --device PATH or PATH,BAUD, such as /dev/ttyACM0");
    memcpy(path, device, n);
    path[n] = '\0';
    if (!comma)
        return MK_OK;
    const char *baud = comma + 1;
    size_t digits = strlen(baud);
    if (digits == 0 || digits > 9 || strspn(baud, "0123456789") != digits ||
        !code_of(strtoul(baud, NULL, 10), rate))
        return wrong_rate(baud, err);
    return MK_OK;
}

static enum mk_status only_one(char path[PATH_SIZE], struct mk_error *err)
{
    struct mk_board_found found[2];
    int n = mk_serial_find(found, 2);
    if (n == 0)
        return mk_error_set(err, MK_ERR_NOTFOUND,
                            "no USB serial port (/dev/ttyACM*, /dev/ttyUSB*): plug the board in, "
                            "or name another port with --device PATH");
    if (n > 1)
        return mk_error_set(err, MK_ERR_USAGE,
                            "%d serial ports, %s and %s among them: say which one with --device "
                            "PATH (`mechkit boards` lists them)",
                            n, found[0].device, found[1].device);
    snprintf(path, PATH_SIZE, "%s", found[0].device);
    return MK_OK;
}

/* --- opening -----------------------------------------------------------------------------------
 */

static const char *kind_of(mode_t mode)
{
    return S_ISDIR(mode)    ? "a folder"
           : S_ISREG(mode)  ? "a plain file"
           : S_ISBLK(mode)  ? "a block device"
           : S_ISFIFO(mode) ? "a pipe"
           : S_ISSOCK(mode) ? "a socket"
                            : "another device";
}

static enum mk_status wrong_kind(const char *path, const char *kind, struct mk_error *err)
{
    return mk_error_set(err, MK_ERR_USAGE,
                        "%s is %s, not a serial port: one is called /dev/ttyACM0, /dev/ttyUSB0 or "
                        "/dev/ttyS0 (`mechkit boards` lists those on USB)",
                        path, kind);
}

static enum mk_status open_error(const char *path, int why, struct mk_error *err)
{
    switch (why) {
    case ENOENT:
    case ENODEV:
    case ENXIO:
    case EIO:
        return mk_error_set(err, MK_ERR_NOTFOUND,
                            "no serial port %s: is the board plugged in? `mechkit boards` lists "
                            "those on USB",
                            path);
    case EACCES:
    case EPERM:
        return mk_error_set(err, MK_ERR_PERM,
                            "no permission for %s: join its group (`adduser YOU dialout`), log in "
                            "again",
                            path);
    case EBUSY:
    case EWOULDBLOCK:
        return mk_error_set(err, MK_ERR_BUSY, "another program uses %s: close it first", path);
    default:
        return mk_error_errno(err, why, path, "cannot open the serial port");
    }
}

void mk_serial_make_raw(struct termios *t)
{
    cfmakeraw(t);
    t->c_iflag &= ~(tcflag_t)(IXOFF | INPCK);
    t->c_cflag |= CLOCAL | CREAD;
    t->c_cflag &= ~(tcflag_t)(CRTSCTS | CSTOPB);
    /* 0 bytes are then the end of the line, and none of them is "later". */
    t->c_cc[VMIN] = 1;
    t->c_cc[VTIME] = 0;
}

/* An adapter that collects bytes for 16 ms (FTDI's default) before it hands them on is of no use
 * here. Ports that know nothing of it say so, which does not matter. */
static void ask_for_low_latency(int fd)
{
    struct serial_struct s;
    if (ioctl(fd, TIOCGSERIAL, &s) != 0)
        return;
    s.flags |= ASYNC_LOW_LATENCY;
    (void)ioctl(fd, TIOCSSERIAL, &s);
}

static enum mk_status configure(struct mk_serial *s, const char *path, speed_t rate,
                                struct mk_error *err)
{
    struct termios t, now;
    /* Others that lock ports keep off then, root as well; TIOCEXCL keeps off the rest. */
    if (flock(s->fd, LOCK_EX | LOCK_NB) != 0)
        return open_error(path, errno, err);
    (void)ioctl(s->fd, TIOCEXCL);
    t = s->before;
    mk_serial_make_raw(&t);
    if (cfsetispeed(&t, rate) != 0 || cfsetospeed(&t, rate) != 0 ||
        tcsetattr(s->fd, TCSANOW, &t) != 0 || tcgetattr(s->fd, &now) != 0)
        return mk_error_errno(err, errno, path, "cannot set the serial port up");
    /* tcsetattr is content when it could do some of it. */
    if (cfgetospeed(&now) != rate || (now.c_lflag & (ICANON | ECHO)) != 0)
        return mk_error_set(err, MK_ERR_RANGE,
                            "%s does not do this many bits per second: give another number, "
                            "--device %s,460800",
                            path, path);
    ask_for_low_latency(s->fd);
    (void)tcflush(s->fd, TCIOFLUSH); /* what was for whoever had it before */
    return MK_OK;
}

static enum mk_status open_path(struct mk_serial *s, const char *path, struct mk_error *err)
{
    struct stat info;
    /* Looked at before it is opened: opening a device can do something. */
    if (stat(path, &info) == 0 && !S_ISCHR(info.st_mode))
        return wrong_kind(path, kind_of(info.st_mode), err);
    s->fd = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (s->fd < 0)
        return open_error(path, errno, err);
    enum mk_status st = MK_OK;
    if (tcgetattr(s->fd, &s->before) != 0)
        st = errno == ENOTTY || errno == EINVAL ? wrong_kind(path, "another device", err)
                                                : open_error(path, errno, err);
    else if (tcgetpgrp(s->fd) >= 0)
        st = wrong_kind(path, "the terminal that this program runs in", err);
    if (st != MK_OK) {
        close(s->fd);
        s->fd = -1;
    }
    return st;
}

enum mk_status mk_serial_open(struct mk_serial *s, const char *device, struct mk_error *err)
{
    char path[PATH_SIZE];
    speed_t rate = 0;
    memset(s, 0, sizeof *s);
    s->fd = -1;
    (void)code_of(MK_SERIAL_BAUD, &rate);
    enum mk_status st = device ? split(device, path, &rate, err) : only_one(path, err);
    if (st == MK_OK)
        st = open_path(s, path, err);
    if (st != MK_OK)
        return st;
    st = configure(s, path, rate, err);
    if (st != MK_OK) {
        close(s->fd); /* as it was, where it belongs to another program */
        s->fd = -1;
    }
    return st;
}

/* What was not sent by now is of no use, and close would wait for it. */
void mk_serial_close(struct mk_serial *s)
{
    if (s->fd < 0)
        return;
    (void)tcflush(s->fd, TCIOFLUSH);
    (void)tcsetattr(s->fd, TCSANOW, &s->before);
    (void)ioctl(s->fd, TIOCNXCL);
    close(s->fd);
    s->fd = -1;
}

/* --- listing -----------------------------------------------------------------------------------
 */

/* First line of a file, as it may be shown; false: there is none. */
static bool read_line(const char *path, char *out, size_t size)
{
    char line[128] = "";
    FILE *f = fopen(path, "re");
    if (!f)
        return false;
    bool any = fgets(line, sizeof line, f) != NULL;
    fclose(f);
    line[strcspn(line, "\n")] = '\0';
    if (any)
        mk_show_text(out, size, line);
    return any;
}

/* The USB device is the parent of an ACM port's interface, and the grandparent of an adapter's. */
static void name_device(const char *sys, const char *name, struct mk_board_found *f)
{
    static const char *const parents[] = {"..", "../.."};
    char path[2 * PATH_SIZE];
    snprintf(f->name, sizeof f->name, "serial port");
    for (size_t i = 0; i < sizeof parents / sizeof parents[0]; i++) {
        snprintf(path, sizeof path, "%.200s/%.60s/device/%s/product", sys, name, parents[i]);
        if (read_line(path, f->name, sizeof f->name))
            return;
    }
}

static void describe(const char *path, const char *sys, struct mk_board_found *f)
{
    struct mk_error err = MK_ERROR_INIT;
    const char *slash = strrchr(path, '/');
    *f = (struct mk_board_found){.status = MK_OK};
    snprintf(f->device, sizeof f->device, "%.63s", path);
    snprintf(f->where, sizeof f->where, "USB");
    name_device(sys, slash ? slash + 1 : path, f);
    if (access(path, R_OK | W_OK) == 0)
        return;
    f->status = open_error(path, errno, &err);
    snprintf(f->note, sizeof f->note, "%.255s", err.message);
}

int mk_serial_find_in(const char *dev, const char *sys, struct mk_board_found *out, int max)
{
    static const char *const names[] = {"ttyACM*", "ttyUSB*"};
    int n = 0;
    for (size_t k = 0; k < sizeof names / sizeof names[0]; k++) {
        char pattern[PATH_SIZE];
        glob_t list;
        snprintf(pattern, sizeof pattern, "%.200s/%s", dev, names[k]);
        if (glob(pattern, 0, NULL, &list) != 0)
            continue;
        for (size_t i = 0; i < list.gl_pathc; i++, n++)
            if (n < max)
                describe(list.gl_pathv[i], sys, &out[n]);
        globfree(&list);
    }
    return n;
}

int mk_serial_find(struct mk_board_found *out, int max)
{
    return mk_serial_find_in("/dev", "/sys/class/tty", out, max);
}

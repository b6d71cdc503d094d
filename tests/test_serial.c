/* Boards behind serial ports: what is a port and what is not, how it is set while it is open, who
 * has it, and how it is listed. The ports are pseudo-terminals of the kernel, with an emulated
 * board behind them (support/remote.h). */
#include "suites.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <glob.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "driver/serial.h"
#include "support/files.h"
#include "support/remote.h"
#include "support/wall.h"

START_TEST(a_device_of_another_kind_is_told)
{
    static const struct {
        const char *path, *kind;
    } rows[] = {{"folder", "a folder"},
                {"file", "a plain file"},
                {"pipe", "a pipe"},
                {"/dev/null", "another device"}};
    mkdir(scratch("folder"), 0755);
    scratch_text("file", "text");
    ck_assert_int_eq(mkfifo(scratch("pipe"), 0600), 0);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const char *path = rows[i].path[0] == '/' ? rows[i].path : scratch(rows[i].path);
        ck_assert_int_eq(remote_try_open("serial", path), MK_ERR_USAGE);
        remote_says(rows[i].kind);
        remote_says("not a serial port");
    }
    ck_assert_int_eq(remote_try_open("serial", scratch("nothing")), MK_ERR_NOTFOUND);
    remote_says("plugged in");
    ck_assert_int_eq(remote_try_open("serial", ""), MK_ERR_USAGE);
    if (mk_serial_find(NULL, 0) > 0)
        return; /* a machine with ports: which of them is the first is none of ours */
    ck_assert_int_eq(remote_try_open("serial", NULL), MK_ERR_NOTFOUND);
    remote_says("/dev/ttyACM*");
}
END_TEST

START_TEST(a_path_is_as_long_as_there_is_room_for_or_no_device_at_all)
{
    static const struct {
        size_t length;
        enum mk_status status;
    } rows[] = {{255, MK_ERR_NOTFOUND}, {256, MK_ERR_USAGE}, {4000, MK_ERR_USAGE}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        char path[4001];
        memset(path, 'x', rows[i].length);
        memcpy(path, "/no/such/folder/", 16);
        path[rows[i].length] = '\0';
        ck_assert_int_eq(remote_try_open("serial", path), rows[i].status);
    }
}
END_TEST

START_TEST(a_device_of_another_kind_is_not_kept_open)
{
    struct mk_serial s = {.fd = 0};
    int free_before = dup(STDIN_FILENO);
    close(free_before);
    ck_assert_int_eq(mk_serial_open(&s, "/dev/null", &remote.err), MK_ERR_USAGE);
    ck_assert_int_eq(s.fd, -1);
    int free_after = dup(STDIN_FILENO);
    close(free_after);
    ck_assert_int_eq(free_after, free_before);
}
END_TEST

START_TEST(the_terminal_of_the_program_itself_is_not_taken_for_a_board)
{
    struct emu_board none = {0};
    int status;
    emu_stream_init(&remote.bench.stream, EMU_PTY, none);
    pid_t pid = fork();
    if (pid == 0) {
        setsid();
        int own = open(remote.bench.stream.device, O_RDWR);
        bool told = own >= 0 &&
                    remote_try_open("serial", remote.bench.stream.device) == MK_ERR_USAGE &&
                    strstr(remote.err.message, "the terminal that this program runs in");
        _exit(told ? 0 : 1);
    }
    ck_assert_int_eq(waitpid(pid, &status, 0), pid);
    ck_assert_int_eq(status, 0);
    emu_stream_free(&remote.bench.stream);
}
END_TEST

/* Opening its port resets it: eight greetings are lost, longer than one request is patient. */
START_TEST(a_board_that_still_boots_is_waited_for)
{
    remote_plug_in("serial");
    emu_line_arm(remote.bench.line, EMU_FAULT_LOSE_REQUEST, 0, 8);
    remote_must(remote_open());
    ck_assert_uint_eq(remote.bench.line->injected, 8);
    remote_close();
    emu_line_arm(remote.bench.line, EMU_FAULT_LOSE_REQUEST, 0, 1000);
    double start = wall_s();
    ck_assert_int_eq(remote_open(), MK_ERR_TIMEOUT);
    remote_says("no answer to 'hello'");
    ck_assert_double_le(wall_s() - start, 5.0);
}
END_TEST

START_TEST(a_rate_that_is_none_or_too_slow_is_told)
{
    static const char *const rates[] = {"9600", "115200", "fast", "", "-230400", "99999999999"};
    char device[128];
    remote_sit_at("serial");
    for (size_t i = 0; i < sizeof rates / sizeof rates[0]; i++) {
        struct mk_serial s;
        snprintf(device, sizeof device, "%s,%s", remote.bench.device, rates[i]);
        ck_assert_int_eq(mk_serial_open(&s, device, &remote.err), MK_ERR_USAGE);
        remote_says("230400, 460800");
    }
}
END_TEST

START_TEST(a_path_that_is_there_may_hold_a_comma)
{
    struct mk_serial s;
    struct emu_board none = {0};
    emu_stream_init(&remote.bench.stream, EMU_PTY, none);
    ck_assert_int_eq(symlink(remote.bench.stream.device, scratch("port,9600")), 0);
    ck_assert_msg(mk_serial_open(&s, scratch("port,9600"), &remote.err) == MK_OK, "%s",
                  remote.err.message);
    mk_serial_close(&s);
    ck_assert_int_eq(unlink(scratch("port,9600")), 0);
    emu_stream_free(&remote.bench.stream);
}
END_TEST

/* A rate alone names no port, and a path longer than any is not cut to another one. */
START_TEST(a_path_that_is_none_or_too_long_is_told)
{
    struct mk_serial s;
    static char path[8192];
    ck_assert_int_eq(mk_serial_open(&s, ",230400", &remote.err), MK_ERR_USAGE);
    remote_says("PATH,BAUD");
    memset(path, 'x', sizeof path - 1);
    ck_assert_int_eq(mk_serial_open(&s, path, &remote.err), MK_ERR_USAGE);
    remote_says("PATH,BAUD");
    ck_assert_int_eq(s.fd, -1);
}
END_TEST

START_TEST(a_port_is_raw_while_it_is_open_and_then_as_it_was)
{
    struct mk_serial s;
    struct termios before, during, after;
    struct emu_board none = {0};
    char device[128];
    emu_stream_init(&remote.bench.stream, EMU_PTY, none);
    snprintf(device, sizeof device, "%s,460800", remote.bench.stream.device);
    int other = open(remote.bench.stream.device, O_RDWR | O_NOCTTY);
    ck_assert_int_eq(tcgetattr(other, &before), 0);
    before.c_lflag |= ICANON | ECHO;
    before.c_oflag |= OPOST;
    before.c_cflag |= CSTOPB;
    ck_assert_int_eq(tcsetattr(other, TCSANOW, &before), 0);
    ck_assert_msg(mk_serial_open(&s, device, &remote.err) == MK_OK, "%s", remote.err.message);
    ck_assert_int_eq(tcgetattr(other, &during), 0);
    ck_assert_uint_eq(during.c_lflag & (ICANON | ECHO | ISIG | IEXTEN), 0);
    ck_assert_uint_eq(during.c_iflag & (IXON | IXOFF | ICRNL | INLCR | ISTRIP | BRKINT), 0);
    ck_assert_uint_eq(during.c_oflag & OPOST, 0);
    ck_assert_uint_eq(during.c_cflag & (CSIZE | CSTOPB | PARENB), CS8);
    ck_assert_uint_eq(cfgetospeed(&during), B460800);
    mk_serial_close(&s);
    ck_assert_int_eq(tcgetattr(other, &after), 0);
    ck_assert_uint_eq(after.c_lflag, before.c_lflag);
    ck_assert_uint_eq(after.c_oflag, before.c_oflag);
    ck_assert_uint_eq(after.c_cflag, before.c_cflag);
    close(other);
    emu_stream_free(&remote.bench.stream);
}
END_TEST

START_TEST(a_port_that_is_in_use_is_told_and_left_alone)
{
    struct mk_board_sample sample;
    remote_sit_at("serial");
    struct mk_board *first = remote.board;
    ck_assert_int_eq(remote_try_open("serial", remote.bench.device), MK_ERR_BUSY);
    remote_says("another program uses");
    remote.board = first;
    struct mk_serial second = {.fd = 0};
    ck_assert_int_eq(mk_serial_open(&second, remote.bench.device, &remote.err), MK_ERR_BUSY);
    ck_assert_int_eq(second.fd, -1); /* nothing to be closed */
    ck_assert_int_eq(mk_board_exchange(remote.board, 1.0, &sample), MK_OK);
    ck_assert_double_eq(sample.u_applied, 1.0);
}
END_TEST

/* Stands before libc's for the program itself: what a port does that was told otherwise; 0: as it
 * was told. */
static struct {
    speed_t rate;
    tcflag_t local;
} does;

int tcgetattr(int fd, struct termios *t)
{
    int (*next)(int, struct termios *) = (__typeof__(next))dlsym(RTLD_NEXT, "tcgetattr");
    if (next(fd, t) != 0)
        return -1;
    if (does.rate != 0)
        (void)cfsetospeed(t, does.rate);
    t->c_lflag |= does.local;
    return 0;
}

/* tcsetattr is content when it could do some of what was asked. */
START_TEST(a_port_that_does_some_of_what_it_is_told_is_not_taken)
{
    static const struct {
        speed_t rate;
        tcflag_t local;
    } ports[] = {{B230400, 0}, {0, ECHO}, {0, ICANON}};
    struct mk_serial s = {.fd = 0};
    struct emu_board none = {0};
    char device[128];
    emu_stream_init(&remote.bench.stream, EMU_PTY, none);
    snprintf(device, sizeof device, "%s,460800", remote.bench.stream.device);
    does.rate = ports[_i].rate;
    does.local = ports[_i].local;
    ck_assert_int_eq(mk_serial_open(&s, device, &remote.err), MK_ERR_RANGE);
    remote_says("does not do this many bits per second");
    ck_assert_int_eq(s.fd, -1);
    does.rate = 0;
    does.local = 0;
    emu_stream_free(&remote.bench.stream);
}
END_TEST

/* As programs do that lock ports and leave root in. */
START_TEST(a_port_that_is_locked_elsewhere_is_not_kept_open)
{
    struct mk_serial s = {.fd = 0};
    struct emu_board none = {0};
    emu_stream_init(&remote.bench.stream, EMU_PTY, none);
    int other = open(remote.bench.stream.device, O_RDWR | O_NOCTTY);
    ck_assert_int_eq(flock(other, LOCK_EX | LOCK_NB), 0);
    int free_before = dup(STDIN_FILENO);
    close(free_before);
    ck_assert_int_eq(mk_serial_open(&s, remote.bench.stream.device, &remote.err), MK_ERR_BUSY);
    ck_assert_int_eq(s.fd, -1);
    int free_after = dup(STDIN_FILENO);
    close(free_after);
    ck_assert_int_eq(free_after, free_before);
    close(other);
    emu_stream_free(&remote.bench.stream);
}
END_TEST

START_TEST(ports_are_listed_with_the_name_of_what_is_plugged_in)
{
    struct mk_board_found f[4];
    static const char *const folders[] = {"dev",
                                          "sys",
                                          "sys/ttyACM0",
                                          "sys/ttyACM0/board",
                                          "sys/ttyACM0/board/device",
                                          "sys/ttyUSB3",
                                          "sys/ttyUSB3/adapter",
                                          "sys/ttyUSB3/adapter/if0",
                                          "sys/ttyUSB3/adapter/if0/port"};
    char dev[256], sys[256];
    for (size_t i = 0; i < sizeof folders / sizeof folders[0]; i++)
        mkdir(scratch(folders[i]), 0755);
    scratch_text("dev/ttyACM0", "");
    scratch_text("dev/ttyUSB3", "");
    scratch_text("dev/ttyS0", "");
    scratch_text("sys/ttyACM0/board/product", "Rig controller\033[2J\n");
    scratch_text("sys/ttyUSB3/adapter/product", "FT232R USB UART\n");
    ck_assert_int_eq(symlink("board/device", scratch("sys/ttyACM0/device")), 0);
    ck_assert_int_eq(symlink("adapter/if0/port", scratch("sys/ttyUSB3/device")), 0);
    snprintf(dev, sizeof dev, "%s", scratch("dev"));
    snprintf(sys, sizeof sys, "%s", scratch("sys"));
    ck_assert_int_eq(mk_serial_find_in(dev, sys, f, 4), 2);
    ck_assert_ptr_nonnull(strstr(f[0].device, "/dev/ttyACM0"));
    ck_assert_str_eq(f[0].name, "Rig controller\\x1b[2J");
    ck_assert_str_eq(f[1].name, "FT232R USB UART");
    ck_assert_int_eq(f[0].status, MK_OK);
    f[1].device[0] = '\0';
    ck_assert_int_eq(mk_serial_find_in(dev, sys, f, 1), 2); /* more than there is room for */
    ck_assert_str_eq(f[1].device, "");
    ck_assert_int_eq(mk_serial_find_in("/nowhere", sys, f, 4), 0);
    unlink(scratch("sys/ttyUSB3/adapter/product"));
    ck_assert_int_eq(mk_serial_find_in(dev, sys, f, 4), 2);
    ck_assert_str_eq(f[1].name, "serial port"); /* which is all that is known of it */
}
END_TEST

/* Stands before libc's: the folder in whose place /dev is; NULL: in none. */
static const char *dev_is;

__attribute__((visibility("default"))) int glob(const char *pattern, int flags,
                                                int (*fails)(const char *, int), glob_t *found)
{
    int (*next)(const char *, int, int (*)(const char *, int), glob_t *) =
        (__typeof__(next))dlsym(RTLD_NEXT, "glob");
    char there[256];
    if (!dev_is || strncmp(pattern, "/dev/tty", 8) != 0)
        return next(pattern, flags, fails, found);
    snprintf(there, sizeof there, "%s%s", dev_is, pattern + 4);
    return next(there, flags, fails, found);
}

START_TEST(the_only_port_is_taken_unnamed_and_of_two_one_has_to_be_named)
{
    struct mk_serial s;
    struct emu_board none = {0};
    char dev[256];
    emu_stream_init(&remote.bench.stream, EMU_PTY, none);
    mkdir(scratch("ports"), 0755);
    snprintf(dev, sizeof dev, "%s", scratch("ports"));
    ck_assert_int_eq(symlink(remote.bench.stream.device, scratch("ports/ttyUSB7")), 0);
    dev_is = dev;
    ck_assert_msg(mk_serial_open(&s, NULL, &remote.err) == MK_OK, "%s", remote.err.message);
    mk_serial_close(&s);
    scratch_text("ports/ttyACM0", "");
    ck_assert_int_eq(mk_serial_open(&s, NULL, &remote.err), MK_ERR_USAGE);
    remote_says("2 serial ports");
    remote_says("ports/ttyACM0 and ");
    remote_says("ports/ttyUSB7 among them");
    ck_assert_int_eq(s.fd, -1);
    dev_is = NULL;
    emu_stream_free(&remote.bench.stream);
}
END_TEST

Suite *suite_serial(void)
{
    Suite *s = suite_create("serial");
    TCase *t = tcase_create("serial");
    tcase_add_checked_fixture(t, remote_setup, remote_teardown);
    tcase_set_timeout(t, 60);
    tcase_add_test(t, a_device_of_another_kind_is_told);
    tcase_add_test(t, a_path_is_as_long_as_there_is_room_for_or_no_device_at_all);
    tcase_add_test(t, a_device_of_another_kind_is_not_kept_open);
    tcase_add_test(t, the_terminal_of_the_program_itself_is_not_taken_for_a_board);
    tcase_add_test(t, a_board_that_still_boots_is_waited_for);
    tcase_add_test(t, a_rate_that_is_none_or_too_slow_is_told);
    tcase_add_test(t, a_path_that_is_there_may_hold_a_comma);
    tcase_add_test(t, a_path_that_is_none_or_too_long_is_told);
    tcase_add_test(t, a_port_is_raw_while_it_is_open_and_then_as_it_was);
    tcase_add_test(t, a_port_that_is_in_use_is_told_and_left_alone);
    tcase_add_loop_test(t, a_port_that_does_some_of_what_it_is_told_is_not_taken, 0, 3);
    tcase_add_test(t, a_port_that_is_locked_elsewhere_is_not_kept_open);
    tcase_add_test(t, ports_are_listed_with_the_name_of_what_is_plugged_in);
    tcase_add_test(t, the_only_port_is_taken_unnamed_and_of_two_one_has_to_be_named);
    suite_add_tcase(s, t);
    return s;
}

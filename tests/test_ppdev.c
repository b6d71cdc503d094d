/* What ppdev says to a program, call by call: on the stand-in that the other tests use, and, in a
 * virtual machine (MECHKIT_PORT names its node), on the kernel's own driver. That both pass is what
 * the stand-in is trusted for. */
#include "suites.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/parport.h>
#include <linux/ppdev.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "emu/pp.h"

static struct emu_pp port;
static const char *path;
static int fd;

static void nobody_receives(void *ctx, const uint8_t *bytes, size_t n)
{
    (void)ctx, (void)bytes, (void)n;
}

static size_t nobody_answers(void *ctx, uint8_t *bytes, size_t size)
{
    (void)ctx, (void)bytes, (void)size;
    return 0;
}

static void setup(void)
{
    path = getenv("MECHKIT_PORT");
    if (!path) {
        emu_pp_init(&port, 0, 0, (struct emu_board){NULL, nobody_receives, nobody_answers});
        path = port.path;
    }
    fd = open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    ck_assert_msg(fd >= 0, "%s: %s", path, strerror(errno));
}

static void teardown(void)
{
    close(fd);
    if (path == port.path)
        emu_pp_free(&port);
}

/* 0 or the errno of a call. */
#define SAYS(call) ((call) < 0 ? errno : 0)

START_TEST(nothing_moves_on_a_port_that_is_not_claimed)
{
    int mode = IEEE1284_MODE_EPP;
    unsigned char status;
    char byte = 0;
    ck_assert_int_eq(SAYS(ioctl(fd, PPRSTATUS, &status)), EINVAL);
    ck_assert_int_eq(SAYS(ioctl(fd, PPNEGOT, &mode)), EINVAL);
    ck_assert_int_eq(SAYS(ioctl(fd, PPRELEASE)), EINVAL);
    ck_assert_int_eq(SAYS(read(fd, &byte, 1)), EINVAL);
    ck_assert_int_eq(SAYS(write(fd, &byte, 1)), EINVAL);
}
END_TEST

START_TEST(the_mode_may_be_set_before_the_port_is_claimed)
{
    int mode = IEEE1284_MODE_COMPAT;
    ck_assert_int_eq(SAYS(ioctl(fd, PPSETMODE, &mode)), 0);
}
END_TEST

START_TEST(a_port_is_claimed_once_and_asked_for_exclusively_before)
{
    ck_assert_int_eq(SAYS(ioctl(fd, PPEXCL)), 0);
    ck_assert_int_eq(SAYS(ioctl(fd, PPCLAIM)), 0);
    ck_assert_int_eq(SAYS(ioctl(fd, PPCLAIM)), EINVAL);
    ck_assert_int_eq(SAYS(ioctl(fd, PPEXCL)), 0); /* it is */
}
END_TEST

START_TEST(a_port_that_was_claimed_is_not_made_exclusive_any_more)
{
    ck_assert_int_eq(SAYS(ioctl(fd, PPCLAIM)), 0);
    ck_assert_int_eq(SAYS(ioctl(fd, PPEXCL)), EINVAL);
    ck_assert_int_eq(SAYS(ioctl(fd, PPRELEASE)), 0);
    ck_assert_int_eq(SAYS(ioctl(fd, PPEXCL)), EINVAL);
}
END_TEST

START_TEST(a_released_port_can_be_claimed_again)
{
    for (int k = 0; k < 3; k++) {
        ck_assert_int_eq(SAYS(ioctl(fd, PPCLAIM)), 0);
        ck_assert_int_eq(SAYS(ioctl(fd, PPRELEASE)), 0);
    }
    ck_assert_int_eq(SAYS(ioctl(fd, PPRELEASE)), EINVAL);
}
END_TEST

START_TEST(a_claimed_port_tells_its_modes_and_lines)
{
    unsigned modes = 0;
    unsigned char status;
    struct timeval patience = {.tv_usec = 3000};
    ck_assert_int_eq(SAYS(ioctl(fd, PPCLAIM)), 0);
    ck_assert_int_eq(SAYS(ioctl(fd, PPGETMODES, &modes)), 0);
    ck_assert_uint_ne(modes & PARPORT_MODE_PCSPP, 0);
    ck_assert_int_eq(SAYS(ioctl(fd, PPRSTATUS, &status)), 0);
    ck_assert_int_eq(SAYS(ioctl(fd, PPSETTIME, &patience)), 0);
    ck_assert_int_eq(SAYS(ioctl(fd, 0x7099)), EINVAL); /* no such request */
}
END_TEST

/* Where nobody is plugged in that agrees to a mode, the port goes back to the oldest one. */
START_TEST(a_negotiation_that_nobody_answers_fails_and_leaves_the_old_mode)
{
    int epp = IEEE1284_MODE_EPP, nibble = IEEE1284_MODE_NIBBLE, compat = IEEE1284_MODE_COMPAT;
    ck_assert_int_eq(SAYS(ioctl(fd, PPCLAIM)), 0);
    int why = SAYS(ioctl(fd, PPNEGOT, &epp));
    ck_assert_msg(why == EIO || why == ENXIO, "EPP: %s", strerror(why));
    why = SAYS(ioctl(fd, PPNEGOT, &nibble));
    ck_assert_msg(why == EIO || why == ENXIO, "nibble mode: %s", strerror(why));
    ck_assert_int_eq(SAYS(ioctl(fd, PPNEGOT, &compat)), 0);
}
END_TEST

START_TEST(nothing_can_be_read_in_compatibility_mode)
{
    char byte;
    ck_assert_int_eq(SAYS(ioctl(fd, PPCLAIM)), 0);
    ck_assert_int_eq(SAYS(read(fd, &byte, 1)), EIO);
}
END_TEST

Suite *suite_ppdev(void)
{
    Suite *s = suite_create("ppdev");
    TCase *t = tcase_create("ppdev");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_add_test(t, nothing_moves_on_a_port_that_is_not_claimed);
    tcase_add_test(t, the_mode_may_be_set_before_the_port_is_claimed);
    tcase_add_test(t, a_port_is_claimed_once_and_asked_for_exclusively_before);
    tcase_add_test(t, a_port_that_was_claimed_is_not_made_exclusive_any_more);
    tcase_add_test(t, a_released_port_can_be_claimed_again);
    tcase_add_test(t, a_claimed_port_tells_its_modes_and_lines);
    tcase_add_test(t, a_negotiation_that_nobody_answers_fails_and_leaves_the_old_mode);
    tcase_add_test(t, nothing_can_be_read_in_compatibility_mode);
    suite_add_tcase(s, t);
    return s;
}

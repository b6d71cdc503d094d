/* What TCP connections and serial ports have in common: bytes that come in pieces, late, or not at
 * all, and go out to a peer that does not read. Below is a pair of sockets; where a board is needed
 * it is an emulated one (support/remote.h). What a line in trouble does to a run of requests is in
 * test_stream_troubles. */
#include "suites.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdatomic.h>
#include <sys/socket.h>
#include <unistd.h>

#include "driver/byte_stream.h"
#include "mechkit/rig.h"
#include "support/remote.h"
#include "support/wall.h"

static int64_t in_ms(double ms)
{
    return (int64_t)(wall_s() * 1e9 + ms * 1e6);
}

/* A stream at one end of fd, whose other end is the test's. */
static void make_pair(int fd[2], struct mk_byte_stream *s)
{
    ck_assert_int_eq(socketpair(AF_UNIX, SOCK_STREAM, 0, fd), 0);
    fcntl(fd[0], F_SETFL, O_NONBLOCK);
    fcntl(fd[1], F_SETFL, O_NONBLOCK);
    mk_byte_stream_init(s, fd[0]);
}

/* --- the link -------------------------------------------------------------------------------- */

/* What does not fit is over at its deadline; when the peer reads again, whole frames come through.
 */
START_TEST(a_peer_that_does_not_read_holds_nobody_up)
{
    int fd[2];
    uint8_t frame[MK_FRAME_MAX], payload[MK_FRAME_PAYLOAD_MAX] = {0};
    const struct mk_frame f = {MK_FRAME_VERSION, MK_MSG_LCD, sizeof payload, 7, payload};
    size_t n = mk_frame_encode(&f, frame);
    struct mk_byte_stream s;
    enum mk_status st = MK_OK;
    make_pair(fd, &s);
    for (int i = 0; i < 1000000 && st == MK_OK; i++)
        st = mk_byte_stream_link.send(&s, frame, n, in_ms(5));
    ck_assert_int_eq(st, MK_ERR_TIMEOUT);
    for (int i = 0; i < 20; i++) {
        double start = wall_s();
        ck_assert_int_eq(mk_byte_stream_link.send(&s, frame, n, in_ms(5)), MK_ERR_TIMEOUT);
        ck_assert_double_ge(wall_s() - start, 0.004);
        ck_assert_double_le(wall_s() - start, 0.5);
    }
    static struct mk_decoder d;
    uint8_t bytes[4096];
    uint32_t before = 0;
    ssize_t k;
    for (int round = 0; round < 2; round++) {
        before = d.frames;
        while ((k = read(fd[1], bytes, sizeof bytes)) > 0) {
            const uint8_t *p = bytes;
            size_t left = (size_t)k;
            struct mk_frame got;
            while (mk_decoder_next(&d, &p, &left, &got))
                ck_assert_uint_eq(got.length, sizeof payload);
        }
        if (round == 0)
            for (int i = 0; i < 3; i++)
                ck_assert_int_eq(mk_byte_stream_link.send(&s, frame, n, in_ms(5)), MK_OK);
    }
    ck_assert_uint_ge(d.frames - before, 3);
    close(fd[0]);
    close(fd[1]);
}
END_TEST

/* Stands before libc's: a line that takes so many bytes at a time, 0: as many as there are; and one
 * that fails next, with this errno. */
static atomic_size_t line_takes;
static atomic_int line_fails;

__attribute__((visibility("default"))) ssize_t send(int fd, const void *bytes, size_t n, int flags)
{
    ssize_t (*next)(int, const void *, size_t, int) = (__typeof__(next))dlsym(RTLD_NEXT, "send");
    size_t most = atomic_load(&line_takes);
    int why = atomic_exchange(&line_fails, 0);
    if (why != 0) {
        errno = why;
        return -1;
    }
    return next(fd, bytes, most > 0 && n > most ? most : n, flags);
}

START_TEST(a_request_that_goes_out_in_pieces_arrives_whole)
{
    int fd[2];
    struct mk_byte_stream s;
    uint8_t out[200], in[sizeof out];
    make_pair(fd, &s);
    for (size_t i = 0; i < sizeof out; i++)
        out[i] = (uint8_t)(7 * i + 3);
    atomic_store(&line_takes, 9);
    ck_assert_int_eq(mk_byte_stream_link.send(&s, out, sizeof out, in_ms(5000)), MK_OK);
    atomic_store(&line_takes, 0);
    ck_assert_int_eq(read(fd[1], in, sizeof in), sizeof in);
    ck_assert_mem_eq(in, out, sizeof out);
    ck_assert_int_eq(read(fd[1], in, sizeof in), -1);
    close(fd[0]);
    close(fd[1]);
}
END_TEST

START_TEST(a_system_that_is_short_of_memory_costs_a_request_and_not_the_line)
{
    static const int whys[] = {ENOBUFS, ENOMEM};
    int fd[2];
    struct mk_byte_stream s;
    uint8_t in[4];
    make_pair(fd, &s);
    for (size_t i = 0; i < sizeof whys / sizeof whys[0]; i++) {
        atomic_store(&line_fails, whys[i]);
        ck_assert_int_eq(mk_byte_stream_link.send(&s, (const uint8_t *)"one", 3, in_ms(5000)),
                         MK_ERR_PROTO);
        ck_assert_int_eq(read(fd[1], in, sizeof in), -1);
        ck_assert_int_eq(mk_byte_stream_link.send(&s, (const uint8_t *)"two", 3, in_ms(5000)),
                         MK_OK);
        ck_assert_int_eq(read(fd[1], in, sizeof in), 3);
        ck_assert_mem_eq(in, "two", 3);
    }
    close(fd[0]);
    close(fd[1]);
}
END_TEST

START_TEST(what_was_said_before_the_end_is_still_heard)
{
    int fd[2];
    struct mk_byte_stream s;
    const uint8_t *bytes;
    size_t n;
    signal(SIGPIPE, SIG_DFL);
    make_pair(fd, &s);
    ck_assert_int_eq(write(fd[1], "last words", 10), 10);
    close(fd[1]);
    ck_assert_int_eq(mk_byte_stream_link.receive(&s, &bytes, &n, 0), MK_OK);
    ck_assert_uint_eq(n, 10);
    ck_assert_int_eq(mk_byte_stream_link.receive(&s, &bytes, &n, in_ms(1000)), MK_ERR_NODEV);
    ck_assert_int_eq(mk_byte_stream_link.send(&s, (const uint8_t *)"x", 1, in_ms(1000)),
                     MK_ERR_NODEV);
    close(fd[0]);
}
END_TEST

/* However late the host is with it, and however often it asks. */
START_TEST(a_peer_that_has_gone_is_gone_past_every_deadline)
{
    int fd[2];
    struct mk_byte_stream s;
    const uint8_t *bytes;
    size_t n;
    for (int first = 0; first < 2; first++) {
        make_pair(fd, &s);
        close(fd[1]);
        for (int k = first; k < first + 4; k++) {
            enum mk_status st = k % 2 ? mk_byte_stream_link.send(&s, (const uint8_t *)"x", 1, 0)
                                      : mk_byte_stream_link.receive(&s, &bytes, &n, 0);
            ck_assert_int_eq(st, MK_ERR_NODEV);
        }
        close(fd[0]);
    }
}
END_TEST

START_TEST(silence_is_over_at_its_deadline)
{
    int fd[2];
    struct mk_byte_stream s;
    const uint8_t *bytes;
    size_t n;
    make_pair(fd, &s);
    double start = wall_s();
    ck_assert_int_eq(mk_byte_stream_link.receive(&s, &bytes, &n, in_ms(3.5)), MK_ERR_TIMEOUT);
    ck_assert_double_ge(wall_s() - start, 0.0034);
    ck_assert_double_le(wall_s() - start, 0.5);
    ck_assert_int_eq(mk_byte_stream_link.receive(&s, &bytes, &n, 0), MK_ERR_TIMEOUT);
    close(fd[0]);
    close(fd[1]);
}
END_TEST

/* --- boards behind it ------------------------------------------------------------------------ */

START_TEST(answers_that_come_a_byte_at_a_time_are_put_together)
{
    struct mk_board_sample s;
    remote_sit_at(_i == 0 ? "tcp" : "serial");
    remote.bench.stream.cut = 1;
    for (int k = 0; k < 20; k++) {
        int tries = 0; /* 44 looks: a busy machine may take too long over them */
        while (mk_board_exchange(remote.board, 0.25 * k, &s) != MK_OK)
            ck_assert_int_lt(++tries, 200);
        ck_assert_double_eq(s.u_applied, 0.25 * k);
    }
}
END_TEST

/* Its samples are numbered anew: an answer to the last one of the run before would be refused. */
START_TEST(nothing_is_answered_before_the_first_sample_of_a_run)
{
    struct mk_board_sample s;
    remote_sit_at(_i == 0 ? "tcp" : "serial");
    for (int run = 0; run < 2; run++) {
        remote_must(remote.board->ops->stream(remote.board, 2000, &remote.err));
        unsigned asked = remote.bench.line->requests;
        for (unsigned k = 0; k < 20; k++) {
            remote_must(mk_board_exchange(remote.board, 0.1 * k + 1.0, &s));
            ck_assert_uint_eq(remote.bench.line->requests, asked + k);
            ck_assert_double_eq_tol(s.u_applied, k ? 0.1 * k + 1.0 : 0.0, 1e-6);
        }
        ck_assert_int_eq(remote.board->ops->safe_state(remote.board), MK_OK);
    }
}
END_TEST

/* It does not wait for what was the next one of the run before: the clock stands as it did. */
START_TEST(the_first_sample_of_a_stepped_run_comes_at_once)
{
    struct mk_board_sample s, before = {.board_ns = 0};
    remote_sit_at("tcp-stepped");
    for (int run = 0; run < 3; run++) {
        const int64_t now_ns = mk_clock_now_ns(&remote.clock);
        remote_must(remote.board->ops->stream(remote.board, 2000, &remote.err));
        for (int k = 0; k < 5; k++) {
            remote_must(mk_board_exchange(remote.board, 1.0, &s));
            ck_assert_int_eq(mk_clock_now_ns(&remote.clock) - now_ns, k * INT64_C(2000000));
            if (run > 0)
                ck_assert_int_eq(s.board_ns - before.board_ns, k * INT64_C(2000000));
        }
        before = s;
        ck_assert_int_eq(remote.board->ops->safe_state(remote.board), MK_OK);
    }
}
END_TEST

/* Whoever steps the clock makes the same run as the one before. */
START_TEST(a_rig_that_is_stepped_begins_anew_with_each_host)
{
    struct mk_board_sample s[2][20];
    remote_plug_in("tcp-stepped");
    for (int host = 0; host < 2; host++) {
        remote_must(remote_open());
        const double *state = mk_rig_state(remote.bench.board.rig);
        for (int k = 0; k < 20; k++) {
            remote_must(mk_board_exchange(remote.board, 5.0, &s[host][k]));
            mk_clock_sleep_until(&remote.clock, mk_clock_now_ns(&remote.clock) + 2000000);
        }
        ck_assert_double_gt(state[0], 0.5);
        remote_close();
        for (int k = 0; k < 20; k++) {
            ck_assert_int_eq(s[host][k].count[0], s[0][k].count[0]);
            ck_assert_int_eq(s[host][k].board_ns - s[host][0].board_ns, k * INT64_C(2000000));
        }
    }
    ck_assert_int_eq(s[0][0].count[0], 0);
}
END_TEST

/* Not with the motion of the time since anybody looked. */
START_TEST(a_rig_begins_anew_at_the_moment_when_its_clock_is_first_stepped)
{
    static struct mk_emulated e;
    struct mk_step_clock steps;
    struct mk_model model;
    mk_model_default(MK_PLANT_PENDUBOT, &model);
    mk_step_clock_init(&steps);
    const struct mk_board_config config = {.model = &model, .clock = &steps.clock, .start = {0.5}};
    remote_must(mk_emulated_init(&e, &config, "rig", "", &remote.err));
    mk_emulated_allow_steps(&e, &steps);
    const double begins_at = mk_rig_state(e.rig)[0];
    usleep(20000);
    e.hal.step(&e, 0);
    ck_assert_double_eq(mk_rig_state(e.rig)[0], begins_at);
    e.hal.step(&e, e.hal.now_ns(&e) + 20000000);
    ck_assert_double_ne(mk_rig_state(e.rig)[0], begins_at);
    mk_emulated_free(&e);
}
END_TEST

/* Noise begins anew, and what has slipped or stuck is forgotten. */
START_TEST(what_faults_have_done_to_the_counters_of_a_stepped_rig_is_gone_for_the_next_host)
{
    struct mk_board_sample s[2][10], last;
    remote_plug_in("tcp-stepped");
    struct mk_fault_effects *effects = &remote.bench.board.effects;
    for (int host = 0; host < 2; host++) {
        effects->stuck[0] = false;
        effects->noise_counts = 20.0;
        remote_must(remote_open());
        for (int k = 0; k < 10; k++) {
            remote_must(mk_board_exchange(remote.board, 0.0, &s[host][k]));
            ck_assert_int_eq(s[host][k].count[0], s[0][k].count[0]);
        }
        effects->noise_counts = 0.0;
        effects->slip[0] = 500;
        effects->stuck[0] = true;
        remote_must(mk_board_exchange(remote.board, 0.0, &last));
        ck_assert_int_eq(last.count[0], 500);
        remote_close();
    }
    ck_assert_int_ne(s[0][0].count[0], s[0][1].count[0]);
    remote_must(remote_open()); /* it is stuck from its first reading on */
    remote_must(mk_board_exchange(remote.board, 0.0, &last));
    ck_assert_int_eq(last.count[0], 0);
}
END_TEST

/* Where the board's clock follows the host's, what it refuses is not the last request. */
START_TEST(a_run_of_samples_that_a_fault_ended_says_so)
{
    struct mk_board_sample s = {.status = 0};
    remote_sit_at(_i == 0 ? "tcp" : "tcp-stepped");
    remote_must(remote.board->ops->stream(remote.board, 2000, &remote.err));
    for (int k = 0; k < 5; k++)
        remote_must(mk_board_exchange(remote.board, 1.0, &s));
    ck_assert_double_eq(s.u_applied, 1.0);
    mk_device_trip(&remote.bench.board.device, MK_WIRE_FAULT_AMPLIFIER);
    remote_must(mk_board_exchange(remote.board, 1.0, &s));
    ck_assert_uint_ne(s.status & MK_BOARD_ST_FAULT, 0);
    ck_assert_double_eq(s.u_applied, 0.0);
    unsigned asked = remote.bench.line->requests; /* it is not asked for samples any more */
    remote_must(mk_board_exchange(remote.board, 1.0, &s));
    ck_assert_uint_eq(remote.bench.line->requests, asked + 1);
}
END_TEST

START_TEST(a_board_that_does_not_say_it_is_simulated_is_not_driven_in_simulated_time)
{
    const char *name = _i == 0 ? "tcp" : "serial";
    remote_plug_in(name);
    const struct mk_board_config config = remote_config();
    ck_assert_int_eq(
        mk_board_open(mk_board_backend_by_name(name), &config, &remote.board, &remote.err),
        MK_ERR_NOTSUP);
    remote_says("does not say that it is simulated");
    remote_says("leave out --fast");
    ck_assert_ptr_null(remote.board);
    ck_assert_double_eq(remote.bench.board.u, 0.0);
}
END_TEST

Suite *suite_streams(void)
{
    Suite *s = suite_create("streams");
    TCase *t = tcase_create("streams");
    tcase_add_checked_fixture(t, remote_setup, remote_teardown);
    tcase_set_timeout(t, 60);
    tcase_add_test(t, a_peer_that_does_not_read_holds_nobody_up);
    tcase_add_test(t, a_request_that_goes_out_in_pieces_arrives_whole);
    tcase_add_test(t, a_system_that_is_short_of_memory_costs_a_request_and_not_the_line);
    tcase_add_test(t, what_was_said_before_the_end_is_still_heard);
    tcase_add_test(t, a_peer_that_has_gone_is_gone_past_every_deadline);
    tcase_add_test(t, silence_is_over_at_its_deadline);
    tcase_add_loop_test(t, answers_that_come_a_byte_at_a_time_are_put_together, 0, 2);
    tcase_add_loop_test(t, nothing_is_answered_before_the_first_sample_of_a_run, 0, 2);
    tcase_add_test(t, the_first_sample_of_a_stepped_run_comes_at_once);
    tcase_add_test(t, a_rig_that_is_stepped_begins_anew_with_each_host);
    tcase_add_test(t, a_rig_begins_anew_at_the_moment_when_its_clock_is_first_stepped);
    tcase_add_test(
        t, what_faults_have_done_to_the_counters_of_a_stepped_rig_is_gone_for_the_next_host);
    tcase_add_loop_test(t, a_run_of_samples_that_a_fault_ended_says_so, 0, 2);
    tcase_add_loop_test(
        t, a_board_that_does_not_say_it_is_simulated_is_not_driven_in_simulated_time, 0, 2);
    suite_add_tcase(s, t);
    return s;
}

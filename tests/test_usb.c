/* The USB back end on a port that is not there: which board, who may, plugging, streaming. What
 * every back end promises is in test_board.c, what goes wrong on the way in test_bus_faults.c. */
#include "suites.h"

#include <string.h>
#include <unistd.h>

#include "driver/usb_priv.h"
#include "emu/bench.h"
#include "mechkit/loop.h"
#include "mechkit/rig.h"
#include "support/files.h"

static struct mk_model model;
static struct mk_clock clock_;
static struct mk_board_config config;
static struct mk_board *board;
static struct emu_bench bench;
static struct mk_error err;

static void setup(void)
{
    mk_model_default(MK_PLANT_INERTIA_WHEEL, &model);
    mk_clock_init_simulated(&clock_);
    config = (struct mk_board_config){.model = &model, .clock = &clock_};
    board = NULL;
    err = (struct mk_error)MK_ERROR_INIT;
    emu_bench_init(&bench, "usb", &config);
}

static void teardown(void)
{
    mk_board_close(board);
    emu_bench_free(&bench);
}

static enum mk_status try_open(const char *device)
{
    config.device = device;
    return mk_board_open(&bench.ops, &config, &board, &err);
}

static void must_open(const char *device)
{
    enum mk_status st = try_open(device);
    ck_assert_msg(st == MK_OK, "%s", err.message);
}

static enum mk_status trade(double u)
{
    struct mk_board_sample s;
    mk_clock_sleep_until(&clock_, mk_clock_now_ns(&clock_) + 2000000);
    return mk_board_exchange(board, u, &s);
}

/* A request for the board's name, and how long its answer is. */
static size_t put_hello(uint8_t out[MK_FRAME_MAX])
{
    const struct mk_frame f = {MK_FRAME_VERSION, MK_MSG_HELLO, 0, 1, NULL};
    return mk_frame_encode(&f, out);
}
#define HELLO_ANSWER ((size_t)MK_FRAME_HEADER + MK_HELLO_SIZE + MK_FRAME_TRAILER)

/* --- which board -------------------------------------------------------------------------------
 */

START_TEST(a_board_is_found_by_serial_number_among_several)
{
    struct mk_emulated other;
    struct emu_usb port;
    struct mk_board_identity id;
    ck_assert_int_eq(mk_emulated_init(&other, &config, "emulated", "MK-0002", &err), MK_OK);
    emu_usb_init(&port, 2, "MK-0002", emu_board_of(&other));
    emu_usb_plug(&port);
    static const char *const device[] = {"MK-0002", "1209:0001:MK-0002", "MK-0001"};
    static const char *const serial[] = {"MK-0002", "MK-0002", "MK-0001"};
    for (int k = 0; k < 3; k++) {
        must_open(device[k]);
        ck_assert_int_eq(board->ops->identify(board, &id, &err), MK_OK);
        ck_assert_str_eq(id.serial, serial[k]);
        mk_board_close(board);
        board = NULL;
    }
    must_open("1209:0001"); /* any of them */
    mk_board_close(board);
    board = NULL;
    ck_assert_int_eq(try_open("12 9:0001"), MK_ERR_NOTFOUND); /* a serial number that nobody has */
    struct mk_board_found found[4];
    ck_assert_int_eq(mk_usb_find(NULL, NULL, 0, &err), 2); /* counted all the same */
    ck_assert_int_eq(mk_usb_find(NULL, found, 4, &err), 2);
    bool second = strcmp(found[1].device, "MK-0002") == 0; /* in whatever order */
    ck_assert_str_eq(found[second].device, "MK-0002");
    ck_assert_str_eq(found[!second].device, "MK-0001");
    ck_assert_str_eq(found[second].name, "emulated board");
    const char *port_2 = strstr(found[second].where, " port 2");
    ck_assert_ptr_nonnull(port_2);
    ck_assert_str_eq(port_2, " port 2");
    ck_assert_int_eq(found[second].status, MK_OK);
    emu_usb_free(&port);
    mk_emulated_free(&other);
}
END_TEST

START_TEST(more_boards_than_there_is_room_for_are_counted_and_left_out)
{
    struct mk_emulated other;
    struct emu_usb port;
    struct mk_board_found found[2] = {{.name = ""}, {.name = "not written to"}};
    ck_assert_int_eq(mk_emulated_init(&other, &config, "emulated", "MK-0002", &err), MK_OK);
    emu_usb_init(&port, 2, "MK-0002", emu_board_of(&other));
    emu_usb_plug(&port);
    ck_assert_int_eq(mk_usb_find(NULL, found, 1, &err), 2);
    ck_assert_str_eq(found[0].name, "emulated board");
    ck_assert_str_eq(found[1].name, "not written to");
    emu_usb_free(&port);
    mk_emulated_free(&other);
}
END_TEST

START_TEST(a_place_is_told_from_the_bus_to_the_last_hub_as_far_as_there_is_room)
{
    static const uint8_t port[] = {1, 12, 3, 4, 5, 6, 255};
    static const char whole[] = "bus 3 device 27 port 1.12.3.4.5.6.255";
    char out[sizeof whole + 1];
    for (size_t size = 1; size <= sizeof whole; size++) {
        memset(out, '#', sizeof out);
        mk_usb_place(out, size, 3, 27, port, 7);
        ck_assert_uint_eq(strlen(out), size - 1);
        ck_assert(strncmp(out, whole, size - 1) == 0);
        ck_assert_int_eq(out[size], '#');
    }
    mk_usb_place(out, sizeof out, 3, 27, port, 0);
    ck_assert_str_eq(out, "bus 3 device 27");
    mk_usb_place(out, sizeof out, 3, 27, port, LIBUSB_ERROR_OVERFLOW);
    ck_assert_str_eq(out, "bus 3 device 27");
}
END_TEST

/* A console looks for boards again and again; the first round may open what stays open. */
START_TEST(boards_that_are_closed_refused_or_only_listed_leave_no_file_open)
{
    struct mk_board_found found;
    int before = 0;
    for (int round = 0; round < 3; round++) {
        must_open(NULL);
        mk_board_close(board);
        board = NULL;
        ck_assert_int_eq(try_open("MK-9"), MK_ERR_NOTFOUND);
        emu_usb_take(&bench.usb, true);
        ck_assert_int_eq(try_open(NULL), MK_ERR_BUSY);
        emu_usb_take(&bench.usb, false);
        ck_assert_int_eq(mk_usb_find(NULL, &found, 1, &err), 1);
        before = round ? before : open_files();
        ck_assert_int_eq(open_files(), before);
    }
}
END_TEST

START_TEST(a_board_that_is_not_there_is_not_found)
{
    static const char *const device[] = {"MK-9", "1209:0002", "1209:0001:MK-9"};
    for (int k = 0; k < 3; k++) {
        ck_assert_int_eq(try_open(device[k]), MK_ERR_NOTFOUND);
        ck_assert_ptr_nonnull(strstr(err.message, "plugged in"));
        ck_assert_ptr_null(board);
    }
    emu_usb_unplug(&bench.usb);
    ck_assert_int_eq(try_open(NULL), MK_ERR_NOTFOUND);
    ck_assert_int_eq(mk_usb_find(NULL, NULL, 0, &err), 0);
}
END_TEST

/* What a terminal would obey is shown, not sent to it; and goes by what is shown. */
START_TEST(control_characters_in_a_serial_number_are_shown)
{
    struct mk_emulated other;
    struct emu_usb port;
    struct mk_board_found found[4];
    struct mk_board_identity id;
    const char *shown = "A\\x1b[2J\\x07B";
    emu_usb_unplug(&bench.usb);
    ck_assert_int_eq(mk_emulated_init(&other, &config, "emulated", "MK-0003", &err), MK_OK);
    emu_usb_init(&port, 2, "A\x1b[2J\aB", emu_board_of(&other));
    emu_usb_plug(&port);
    ck_assert_int_eq(mk_usb_find(NULL, found, 4, &err), 1);
    ck_assert_str_eq(found[0].device, shown);
    must_open(shown);
    ck_assert_int_eq(board->ops->identify(board, &id, &err), MK_OK);
    ck_assert_str_eq(id.serial, "MK-0003");
    mk_board_close(board);
    board = NULL;
    emu_usb_free(&port);
    mk_emulated_free(&other);
}
END_TEST

START_TEST(a_board_that_claims_what_no_encoder_has_is_refused)
{
    static const int32_t wrong[] = {-4000, INT32_MIN, 100000001, INT32_MAX};
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        bench.board.device.info.cpr[0] = wrong[i];
        ck_assert_int_eq(try_open(NULL), MK_ERR_PROTO);
        ck_assert_ptr_nonnull(strstr(err.message, "counts a turn"));
    }
    bench.board.device.info.cpr[0] = 0;
    must_open(NULL);
}
END_TEST

START_TEST(counters_have_8_to_32_bits)
{
    static const uint8_t wrong[] = {0, 7, 33, 255}, right[] = {8, 24, 32};
    for (size_t i = 0; i < sizeof wrong; i++) {
        bench.board.device.info.counter_bits = wrong[i];
        ck_assert_int_eq(try_open(NULL), MK_ERR_PROTO);
        ck_assert_ptr_nonnull(strstr(err.message, "the board claims counters of"));
    }
    for (size_t i = 0; i < sizeof right; i++) {
        struct mk_board_identity id;
        bench.board.device.info.counter_bits = right[i];
        must_open(NULL);
        ck_assert_int_eq(board->ops->identify(board, &id, &err), MK_OK);
        ck_assert_int_eq(id.counter_bits, right[i]);
        mk_board_close(board);
        board = NULL;
    }
}
END_TEST

/* --- who may ------------------------------------------------------------------------------------
 */

START_TEST(without_permission_the_message_names_the_udev_rule)
{
    struct mk_board_found found;
    emu_usb_deny(&bench.usb, true);
    ck_assert_int_eq(try_open(NULL), MK_ERR_PERM);
    ck_assert_ptr_nonnull(strstr(err.message, "udev rule"));
    ck_assert_int_eq(mk_usb_find(NULL, &found, 1, &err), 1);
    ck_assert_int_eq(found.status, MK_ERR_PERM);
    ck_assert_ptr_nonnull(strstr(found.note, "udev rule"));
    emu_usb_deny(&bench.usb, false);
    must_open(NULL);
}
END_TEST

START_TEST(a_board_in_use_elsewhere_is_busy)
{
    emu_usb_take(&bench.usb, true);
    ck_assert_int_eq(try_open(NULL), MK_ERR_BUSY);
    ck_assert_ptr_nonnull(strstr(err.message, "another program"));
    emu_usb_take(&bench.usb, false);
    must_open(NULL);
}
END_TEST

START_TEST(a_kernel_driver_on_the_interface_is_put_aside)
{
    struct mk_board_found found;
    emu_usb_bind_driver(&bench.usb, true);
    ck_assert_int_eq(mk_usb_find(NULL, &found, 1, &err), 1);
    ck_assert_int_eq(found.status, MK_OK);
    ck_assert(bench.usb.driver_bound); /* whoever only looks takes nothing away */
    must_open(NULL);
    ck_assert_int_eq(trade(1.0), MK_OK);
    mk_board_close(board);
    board = NULL;
    ck_assert(bench.usb.driver_bound);
}
END_TEST

START_TEST(a_device_that_is_not_configured_has_no_endpoints_and_is_no_board)
{
    emu_usb_configure(&bench.usb, false);
    ck_assert_int_eq(try_open(NULL), MK_ERR_NOTSUP);
    ck_assert_ptr_nonnull(strstr(err.message, "no bulk endpoints both ways"));
    ck_assert_ptr_null(board);
    emu_usb_configure(&bench.usb, true);
    must_open(NULL);
}
END_TEST

START_TEST(a_model_beyond_the_boards_limit_is_refused)
{
    model.u_max = 11.0;
    ck_assert_int_eq(try_open(NULL), MK_ERR_RANGE);
    ck_assert_ptr_nonnull(strstr(err.message, "11"));
}
END_TEST

/* Anything libusb can say has a code of ours and a text that tells what to do. */
START_TEST(every_libusb_error_has_a_meaning)
{
    for (int code = LIBUSB_ERROR_IO; code >= LIBUSB_ERROR_NOT_SUPPORTED; code--) {
        ck_assert_int_lt(mk_usb_error(&err, code, "test"), MK_OK);
        ck_assert_ptr_null(strstr(err.message, "unknown kind"));
        ck_assert_ptr_nonnull(strstr(err.message, libusb_error_name(code)));
        ck_assert_int_eq(err.os_code, code);
    }
    ck_assert_int_eq(mk_usb_error(&err, LIBUSB_ERROR_OTHER, "test"), MK_ERR_IO);
}
END_TEST

/* --- plugging ------------------------------------------------------------------------------------
 */

START_TEST(an_unplugged_board_is_gone_and_one_that_is_plugged_in_again_works)
{
    struct mk_board_sample s;
    for (int k = 0; k < 3; k++) {
        must_open(NULL);
        ck_assert_int_eq(trade(5.0), MK_OK);
        emu_usb_unplug(&bench.usb);
        ck_assert_int_eq(trade(5.0), MK_ERR_NODEV);
        ck_assert_int_eq(mk_board_exchange(board, 5.0, &s), MK_ERR_NODEV);
        ck_assert_int_eq(board->ops->safe_state(board), MK_ERR_NODEV);
        ck_assert_int_eq(board->ops->zero_counters(board, &err), MK_ERR_NODEV);
        ck_assert_ptr_nonnull(strstr(err.message, "gone"));
        emu_usb_plug(&bench.usb); /* while the old handle is still open, as in life */
        ck_assert_int_eq(trade(5.0), MK_ERR_NODEV);
        mk_board_close(board);
        board = NULL;
    }
    must_open(NULL);
    ck_assert_int_eq(trade(5.0), MK_OK);
}
END_TEST

/* libusb tells of it between two transfers, on a thread of its own. */
START_TEST(another_board_that_is_unplugged_harms_nobody)
{
    struct mk_emulated other;
    struct emu_usb port;
    ck_assert_int_eq(mk_emulated_init(&other, &config, "emulated", "MK-0002", &err), MK_OK);
    emu_usb_init(&port, 2, "MK-0002", emu_board_of(&other));
    emu_usb_plug(&port);
    must_open("MK-0001");
    ck_assert_int_eq(trade(5.0), MK_OK);
    emu_usb_unplug(&port);
    for (int k = 0; k < 40; k++) {
        usleep(5000);
        ck_assert_int_eq(trade(5.0), MK_OK);
    }
    ck_assert_double_eq(bench.board.u, 5.0);
    emu_usb_free(&port);
    mk_emulated_free(&other);
}
END_TEST

/* No transfer is there to say so then. */
START_TEST(a_board_that_is_unplugged_while_nothing_is_under_way_is_gone)
{
    static struct mk_usb usb;
    ck_assert_int_eq(mk_usb_open(&usb, NULL, &err), MK_OK);
    ck_assert(mk_usb_stop_transfers(&usb));
    ck_assert(!usb.gone);
    emu_usb_unplug(&bench.usb);
    for (int k = 0; k < 400 && !usb.gone; k++) {
        struct timeval moment = {0, 5000};
        (void)libusb_handle_events_timeout_completed(usb.context, &moment, NULL);
    }
    ck_assert(usb.gone);
    mk_usb_close(&usb);
}
END_TEST

START_TEST(a_write_that_could_not_begin_is_nothing_to_wait_for)
{
    static struct mk_usb usb;
    uint8_t hello[MK_FRAME_MAX];
    const size_t size = put_hello(hello);
    ck_assert_int_eq(mk_usb_open(&usb, NULL, &err), MK_OK);
    ck_assert(mk_usb_stop_transfers(&usb));
    emu_usb_unplug(&bench.usb);
    ck_assert_int_eq(mk_usb_link.send(&usb, hello, size, INT64_MAX), MK_ERR_NODEV);
    ck_assert(usb.gone && usb.write_done);
    mk_usb_close(&usb);
}
END_TEST

START_TEST(a_read_that_failed_is_told_once)
{
    static struct mk_usb usb;
    const uint8_t *bytes;
    size_t n = 0;
    ck_assert_int_eq(mk_usb_open(&usb, NULL, &err), MK_OK);
    usb.garbled = true;
    ck_assert_int_eq(mk_usb_link.receive(&usb, &bytes, &n, 0), MK_ERR_PROTO);
    ck_assert_int_eq(mk_usb_link.receive(&usb, &bytes, &n, 0), MK_ERR_TIMEOUT);
    mk_usb_close(&usb);
}
END_TEST

START_TEST(a_board_that_restarts_is_gone_until_it_is_opened_again)
{
    must_open(NULL);
    ck_assert_int_eq(trade(5.0), MK_OK);
    bench.board.sent_size = 5; /* of an answer that nobody has fetched */
    const double stood_at = mk_rig_state(bench.board.rig)[0];
    mk_clock_sleep_until(&clock_, mk_clock_now_ns(&clock_) + 10000000);
    mk_emulated_restart(&bench.board);
    ck_assert_double_ne(mk_rig_state(bench.board.rig)[0], stood_at); /* driven until then */
    ck_assert_uint_eq(bench.board.sent_size, 0);
    ck_assert_int_eq(trade(5.0), MK_ERR_NODEV);
    ck_assert_double_eq(bench.board.u, 0.0);
    mk_board_close(board);
    must_open(NULL);
    ck_assert_int_eq(trade(5.0), MK_OK);
}
END_TEST

/* --- reads that fail -----------------------------------------------------------------------------
 */

/* More often than there are reads under way: each is put again. */
START_TEST(a_read_that_fails_is_told_at_once_and_the_next_answer_is_heard)
{
    static const enum emu_fault kinds[] = {EMU_FAULT_ERROR_IN, EMU_FAULT_OVERFLOW,
                                           EMU_FAULT_STALL_IN};
    const unsigned times = 2 * MK_USB_READS;
    must_open(NULL);
    for (size_t k = 0; k < sizeof kinds / sizeof kinds[0]; k++) {
        emu_line_arm(bench.line, kinds[k], 0, times);
        for (unsigned i = 0; i < times; i++)
            ck_assert_int_eq(trade(1.0), MK_ERR_PROTO);
        ck_assert_uint_eq(bench.line->injected, times);
        ck_assert_int_eq(trade(2.0), MK_OK);
        ck_assert_double_eq(bench.board.u, 2.0);
    }
}
END_TEST

/* The next command starts the reads again, and with that it is done. */
START_TEST(a_read_that_failed_before_a_command_was_sent_is_no_failure_of_its_answer)
{
    static struct mk_usb usb;
    uint8_t hello[MK_FRAME_MAX];
    const uint8_t *bytes;
    size_t size = put_hello(hello), n = 0;
    ck_assert_int_eq(mk_usb_open(&usb, NULL, &err), MK_OK);
    usb.garbled = usb.halted_in = true;
    ck_assert_int_eq(mk_usb_link.send(&usb, hello, size, INT64_MAX), MK_OK);
    ck_assert(!usb.halted_in); /* cleared once: whoever clears it again loses the next packet */
    ck_assert_int_eq(mk_usb_link.receive(&usb, &bytes, &n, INT64_MAX), MK_OK);
    enum mk_status st = MK_OK;
    while (st == MK_OK) /* an answer may come in parts */
        st = mk_usb_link.receive(&usb, &bytes, &n, 0);
    ck_assert_int_eq(st, MK_ERR_TIMEOUT);
    mk_usb_close(&usb);
}
END_TEST

/* Each way has an end that the board has halted when it goes. */
START_TEST(a_board_that_is_unplugged_with_a_halted_endpoint_is_gone)
{
    struct mk_board_sample s;
    must_open(NULL);
    emu_line_arm(bench.line, _i ? EMU_FAULT_STALL_OUT : EMU_FAULT_STALL_IN, 0, 1);
    ck_assert_int_eq(trade(1.0), MK_ERR_PROTO);
    ck_assert_uint_eq(bench.line->injected, 1);
    emu_usb_unplug(&bench.usb);
    ck_assert_int_eq(trade(1.0), MK_ERR_NODEV);
    ck_assert_int_eq(mk_board_exchange(board, 1.0, &s), MK_ERR_NODEV);
}
END_TEST

/* It is waited for before the next one, which then goes out. */
START_TEST(a_write_that_comes_back_long_after_it_was_cancelled_holds_up_no_later_one)
{
    must_open(NULL);
    bench.usb.keeps_blocked = true;
    emu_line_arm(bench.line, EMU_FAULT_BLOCK_OUT, 0, 1);
    ck_assert_int_eq(trade(1.0), MK_ERR_TIMEOUT);
    emu_usb_give_back(&bench.usb);
    ck_assert_int_eq(trade(2.0), MK_OK);
    ck_assert_double_eq(bench.board.u, 2.0);
}
END_TEST

/* Whatever became of it, nothing of it is left when the next one is sent. */
START_TEST(how_a_write_ended_is_told_and_a_board_that_is_gone_is_written_to_no_more)
{
    static const struct {
        enum emu_fault fault;
        enum mk_status st;
    } rows[] = {{EMU_FAULT_BLOCK_OUT, MK_ERR_TIMEOUT},
                {EMU_FAULT_STALL_OUT, MK_ERR_PROTO},
                {EMU_FAULT_ERROR_OUT, MK_ERR_PROTO}};
    static struct mk_usb usb;
    uint8_t hello[MK_FRAME_MAX];
    const size_t size = put_hello(hello);
    ck_assert_int_eq(mk_usb_open(&usb, NULL, &err), MK_OK);
    emu_line_arm(bench.line, rows[_i].fault, 0, 1);
    ck_assert_int_eq(mk_usb_link.send(&usb, hello, size, mk_usb_now_ns() + 20000000), rows[_i].st);
    ck_assert_uint_eq(bench.line->injected, 1);
    ck_assert(usb.write_done);
    ck_assert_int_eq(mk_usb_link.send(&usb, hello, size, INT64_MAX), MK_OK);
    ck_assert(!usb.halted_out);
    usb.gone = true;
    ck_assert_int_eq(mk_usb_link.send(&usb, hello, size, INT64_MAX), MK_ERR_NODEV);
    mk_usb_close(&usb);
}
END_TEST

/* The host may have been away for longer than it wanted to wait. */
START_TEST(an_answer_that_is_there_is_heard_after_the_deadline)
{
    static struct mk_usb usb;
    uint8_t hello[MK_FRAME_MAX];
    const uint8_t *bytes;
    size_t n = 0, size = put_hello(hello), heard = 0;
    ck_assert_int_eq(mk_usb_open(&usb, NULL, &err), MK_OK);
    memcpy(usb.write_bytes, hello, size);
    usb.write->length = (int)size;
    usb.write_done = 0;
    ck_assert_int_eq(libusb_submit_transfer(usb.write), LIBUSB_SUCCESS); /* and looks at nothing */
    for (int k = 0; k < 10 && heard < HELLO_ANSWER; k++) {
        usleep(2000);
        if (mk_usb_link.receive(&usb, &bytes, &n, mk_usb_now_ns() - 5000000000) == MK_OK)
            heard += n;
    }
    ck_assert_uint_eq(heard, HELLO_ANSWER);
    mk_usb_close(&usb);
}
END_TEST

/* Their memory goes with them, and nobody waits for what will not come. */
START_TEST(all_transfers_are_given_back_before_a_board_is_closed)
{
    static struct mk_usb usb;
    ck_assert_int_eq(mk_usb_open(&usb, NULL, &err), MK_OK);
    for (int i = 0; i < MK_USB_READS; i++)
        ck_assert(usb.read[i].under_way);
    ck_assert(mk_usb_stop_transfers(&usb));
    for (int i = 0; i < MK_USB_READS; i++)
        ck_assert(!usb.read[i].under_way);
    mk_usb_close(&usb);
    mk_usb_close(&usb); /* nothing is left to be given back */
}
END_TEST

/* --- streaming -----------------------------------------------------------------------------------
 */

START_TEST(streamed_samples_arrive_and_their_answers_act)
{
    must_open(NULL);
    struct mk_wire *wire = board->priv;
    struct mk_wire_reading r;
    uint32_t number;
    int64_t before_ns = 0;
    ck_assert_int_eq(board->ops->set_watchdog(board, 20, &err), MK_OK);
    ck_assert_int_eq(mk_wire_stream(wire, 2000, &err), MK_OK);
    for (uint32_t k = 0; k < 200; k++) {
        ck_assert_int_eq(mk_wire_next_sample(wire, 1000000000, &number, &r), MK_OK);
        ck_assert_uint_eq(number, k);
        ck_assert_uint_eq(r.status, MK_WIRE_ST_STREAMING);
        if (k > 0)
            ck_assert_int_eq(r.sample.board_ns - before_ns, 2000000);
        ck_assert_double_eq(r.sample.u_applied, k ? (double)((k - 1) % 7) : 0.0);
        before_ns = r.sample.board_ns;
        ck_assert_int_eq(mk_wire_answer_sample(wire, number, (double)(k % 7)), MK_OK);
    }
    ck_assert_int_eq(mk_wire_stream(wire, 0, &err), MK_OK);
    ck_assert_int_eq(trade(1.0), MK_OK);
}
END_TEST

START_TEST(the_panel_is_reached_through_the_bus)
{
    must_open(NULL);
    struct mk_wire_state state;
    bench.board.switches = 5;
    ck_assert_int_eq(mk_wire_lcd(board->priv, 0, "hello, longer than twenty", &err), MK_OK);
    ck_assert_str_eq(bench.board.lcd[0], "hello, longer than t");
    ck_assert_int_eq(mk_wire_leds(board->priv, 3, &err), MK_OK);
    ck_assert_uint_eq(bench.board.leds, 3);
    ck_assert_int_eq(mk_wire_state(board->priv, &state, &err), MK_OK);
    ck_assert_uint_eq(state.switches, 5);
    ck_assert_int_eq(mk_wire_lcd(board->priv, 2, "", &err), MK_ERR_RANGE);
}
END_TEST

START_TEST(more_than_the_buffer_holds_is_counted_and_dropped)
{
    static struct mk_usb usb;
    uint8_t hello[MK_FRAME_MAX];
    size_t n = put_hello(hello);
    ck_assert_int_eq(mk_usb_open(&usb, NULL, &err), MK_OK);
    usb.used = MK_USB_BUFFER - 10; /* nobody has looked for a while */
    for (int k = 0; k < 50 && usb.overrun == 0; k++)
        ck_assert_int_eq(mk_usb_link.send(&usb, hello, n, INT64_MAX), MK_OK);
    ck_assert_uint_gt(usb.overrun, 0);
    ck_assert_uint_le(usb.used, MK_USB_BUFFER);
    ck_assert_uint_eq(usb.handed, 0);
    mk_usb_close(&usb);
}
END_TEST

START_TEST(what_just_fits_into_the_buffer_is_kept)
{
    static struct mk_usb usb;
    uint8_t hello[MK_FRAME_MAX];
    size_t n = put_hello(hello);
    ck_assert_int_eq(mk_usb_open(&usb, NULL, &err), MK_OK);
    usb.used = MK_USB_BUFFER - HELLO_ANSWER;
    ck_assert_int_eq(mk_usb_link.send(&usb, hello, n, INT64_MAX), MK_OK);
    for (int k = 0; k < 50 && usb.used < MK_USB_BUFFER && usb.overrun == 0; k++) {
        struct timeval moment = {0, 2000};
        (void)libusb_handle_events_timeout_completed(usb.context, &moment, NULL);
    }
    ck_assert_uint_eq(usb.overrun, 0);
    ck_assert_uint_eq(usb.used, MK_USB_BUFFER);
    mk_usb_close(&usb);
}
END_TEST

Suite *suite_usb(void)
{
    Suite *s = suite_create("usb");
    TCase *t = tcase_create("usb");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_add_test(t, a_board_is_found_by_serial_number_among_several);
    tcase_add_test(t, control_characters_in_a_serial_number_are_shown);
    tcase_add_test(t, a_board_that_claims_what_no_encoder_has_is_refused);
    tcase_add_test(t, counters_have_8_to_32_bits);
    tcase_add_test(t, a_place_is_told_from_the_bus_to_the_last_hub_as_far_as_there_is_room);
    tcase_add_test(t, more_boards_than_there_is_room_for_are_counted_and_left_out);
    tcase_add_test(t, boards_that_are_closed_refused_or_only_listed_leave_no_file_open);
    tcase_add_test(t, a_board_that_is_not_there_is_not_found);
    tcase_add_test(t, without_permission_the_message_names_the_udev_rule);
    tcase_add_test(t, a_board_in_use_elsewhere_is_busy);
    tcase_add_test(t, a_kernel_driver_on_the_interface_is_put_aside);
    tcase_add_test(t, a_device_that_is_not_configured_has_no_endpoints_and_is_no_board);
    tcase_add_test(t, a_model_beyond_the_boards_limit_is_refused);
    tcase_add_test(t, every_libusb_error_has_a_meaning);
    tcase_add_test(t, an_unplugged_board_is_gone_and_one_that_is_plugged_in_again_works);
    tcase_add_test(t, another_board_that_is_unplugged_harms_nobody);
    tcase_add_test(t, a_board_that_is_unplugged_while_nothing_is_under_way_is_gone);
    tcase_add_test(t, a_write_that_could_not_begin_is_nothing_to_wait_for);
    tcase_add_test(t, a_read_that_failed_is_told_once);
    tcase_add_test(t, a_board_that_restarts_is_gone_until_it_is_opened_again);
    tcase_add_test(t, a_read_that_fails_is_told_at_once_and_the_next_answer_is_heard);
    tcase_add_test(t, a_read_that_failed_before_a_command_was_sent_is_no_failure_of_its_answer);
    tcase_add_loop_test(t, a_board_that_is_unplugged_with_a_halted_endpoint_is_gone, 0, 2);
    tcase_add_test(t, a_write_that_comes_back_long_after_it_was_cancelled_holds_up_no_later_one);
    tcase_add_loop_test(t, how_a_write_ended_is_told_and_a_board_that_is_gone_is_written_to_no_more,
                        0, 3);
    tcase_add_test(t, an_answer_that_is_there_is_heard_after_the_deadline);
    tcase_add_test(t, all_transfers_are_given_back_before_a_board_is_closed);
    tcase_add_test(t, streamed_samples_arrive_and_their_answers_act);
    tcase_add_test(t, the_panel_is_reached_through_the_bus);
    tcase_add_test(t, more_than_the_buffer_holds_is_counted_and_dropped);
    tcase_add_test(t, what_just_fits_into_the_buffer_is_kept);
    suite_add_tcase(s, t);
    return s;
}

/* libFuzzer: the host's side of the protocol, over USB, the parallel port and a bare link, and a
 * board that answers anything: right, wrong, late, for ever. The first byte chooses the link.
 * Whatever comes, a call ends in bounded time, says why it failed, and hands out what can be used.
 */
#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "driver/backends.h"
#include "driver/standalone.h"
#include "driver/usb.h"
#include "wire_talk.h"

#define CALLS 64
#define FOUND 2
#define RECORDS 8

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static __attribute__((noinline)) void must(int holds)
{
    if (!holds)
        abort();
}

static void must_be_text(const char *text, size_t size)
{
    must(memchr(text, '\0', size) != NULL);
    for (; *text; text++)
        must(isprint((unsigned char)*text));
}

/* --- a bare link -------------------------------------------------------------------------------
 */

static uint8_t received[MK_FRAME_MAX];

static enum mk_status bare_send(void *link, const uint8_t *bytes, size_t n, int64_t deadline_ns)
{
    (void)link, (void)deadline_ns;
    must(n <= MK_FRAME_MAX);
    talk_heard(bytes, n);
    return MK_OK;
}

static enum mk_status bare_receive(void *link, const uint8_t **bytes, size_t *n,
                                   int64_t deadline_ns)
{
    (void)link;
    *bytes = received;
    switch (talk_say(received, sizeof received, n)) {
    case TALK_BYTES:
        return MK_OK;
    case TALK_GONE:
        return MK_ERR_NODEV;
    case TALK_GARBLED:
        return MK_ERR_PROTO;
    default:
        talk_pass(deadline_ns - talk_now_ns());
        return MK_ERR_TIMEOUT;
    }
}

static enum mk_status bare_open(struct mk_board *board, const struct mk_board_config *c,
                                struct mk_error *err)
{
    static const struct mk_link_ops ops = {bare_send, bare_receive};
    (void)c;
    return mk_wire_open(board->priv, &ops, NULL, err);
}

static void bare_close(struct mk_board *board)
{
    (void)board;
}

static const struct mk_board_ops bare = {.name = "bare",
                                         .private_size = sizeof(struct mk_wire),
                                         .open = bare_open,
                                         MK_WIRE_BOARD_SLOTS,
                                         .close = bare_close};

/* --- what a host asks for ----------------------------------------------------------------------
 */

static void check_identity(const struct mk_board_identity *id)
{
    must_be_text(id->name, sizeof id->name);
    must_be_text(id->firmware, sizeof id->firmware);
    must_be_text(id->serial, sizeof id->serial);
    must(id->counter_bits >= 8 && id->counter_bits <= 32);
    must(id->encoder_cpr[0] >= 0 && id->encoder_cpr[1] >= 0);
}

static enum mk_status exchange(struct mk_board *b)
{
    struct mk_board_sample s;
    int64_t begin_ns = talk_now_ns();
    enum mk_status st = mk_board_exchange(b, (double)talk_byte() / 30.0, &s);
    must(st != MK_OK || isfinite(s.u_applied));
    must(talk_now_ns() - begin_ns < 500000000 + 2000 * (int64_t)mk_wire_of(b)->stream_us);
    return st;
}

static enum mk_status upload(struct mk_wire *w, struct mk_error *err)
{
    struct mk_standalone_record *out = calloc(RECORDS, sizeof *out);
    int got = -1, max = 1 + talk_byte() % RECORDS;
    must(out != NULL);
    enum mk_status st = mk_wire_upload(w, talk_byte(), out, max, &got, err);
    must(st != MK_OK || (got >= 0 && got <= max));
    free(out);
    return st;
}

static enum mk_status set_up(struct mk_wire *w, struct mk_error *err)
{
    static const float value[MK_STANDALONE_GAINS];
    int gains = -1;
    enum mk_status st = mk_wire_setup(w, talk_byte(), 2000, 1, &gains, err);
    if (st != MK_OK)
        return st;
    must(gains >= 0 && gains <= MK_STANDALONE_GAINS);
    return mk_wire_gains(w, 0, value, gains, err);
}

static void call(struct mk_board *b)
{
    struct mk_wire *w = mk_wire_of(b);
    struct mk_board_identity id;
    struct mk_wire_state state;
    struct mk_error err = MK_ERROR_INIT;
    enum mk_status st = MK_OK;
    bool told = true; /* the reason, in err */
    switch (talk_byte() % 12) {
    case 0:
        st = b->ops->identify(b, &id, &err);
        if (st == MK_OK)
            check_identity(&id);
        break;
    case 1:
        st = b->ops->zero_counters(b, &err);
        break;
    case 2:
        st = b->ops->stream(b, (uint32_t)talk_byte() * 250, &err);
        break;
    case 3:
        st = b->ops->set_watchdog(b, talk_byte(), &err);
        break;
    case 4:
        st = b->ops->safe_state(b);
        told = false;
        break;
    case 5:
        st = set_up(w, &err);
        break;
    case 6:
        st = upload(w, &err);
        break;
    case 7:
        st = mk_wire_lcd(w, talk_byte() & 1, "a text longer than the display is", &err);
        break;
    case 8:
        st = mk_wire_state(w, &state, &err);
        must(mk_wire_fault_text(state.fault) != NULL || st != MK_OK);
        break;
    case 9:
        st = talk_byte() & 1 ? mk_wire_start(w, &err) : mk_wire_halt(w, &err);
        break;
    default:
        st = exchange(b);
        told = false;
        break;
    }
    if (st != MK_OK && told)
        must_be_text(err.message, sizeof err.message);
    must(st == MK_OK || !told || err.message[0] != '\0');
    must(w->decoder.used <= MK_FRAME_MAX); /* the newest answer is still in there */
}

static void look_for_boards(void)
{
    static struct mk_board_found found[FOUND];
    struct mk_error err = MK_ERROR_INIT;
    memset(found, 0, sizeof found);
    int n = mk_usb_find(NULL, found, FOUND, &err);
    must(n >= 0 || err.message[0] != '\0');
    for (int i = 0; i < n && i < FOUND; i++) {
        must_be_text(found[i].name, sizeof found[i].name);
        must_be_text(found[i].device, sizeof found[i].device);
        must_be_text(found[i].where, sizeof found[i].where);
        must_be_text(found[i].note, sizeof found[i].note);
    }
}

static void talk_to(const struct mk_board_ops *ops, const char *device)
{
    static struct mk_model model; /* of no motor: every board is strong enough */
    const struct mk_board_config config = {.model = &model, .device = device};
    struct mk_error err = MK_ERROR_INIT;
    struct mk_board board = {.ops = ops, .u_max = 10.0, .priv = calloc(1, ops->private_size)};
    must(board.priv != NULL);
    int64_t begin_ns = talk_now_ns();
    enum mk_status st = ops->open(&board, &config, &err);
    must((st == MK_OK) == (err.message[0] == '\0'));
    must(talk_now_ns() - begin_ns < 5000000000);
    if (st == MK_OK)
        check_identity(&mk_wire_of(&board)->identity);
    else
        must_be_text(err.message, sizeof err.message);
    for (int i = 0; st == MK_OK && i < CALLS && !talk_ended(); i++) {
        begin_ns = talk_now_ns();
        call(&board);
        must(talk_now_ns() - begin_ns < 5000000000);
    }
    if (st == MK_OK)
        ops->close(&board);
    free(board.priv);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    talk_begin(data, size);
    switch (talk_byte() % 5) {
    case 0:
        talk_to(&mk_board_usb_ops, NULL);
        break;
    case 1:
        talk_to(&mk_board_usb_ops, "1209:0001:A\\x1b");
        break;
    case 2:
        talk_to(&mk_board_parport_ops, "/dev/parport0");
        break;
    case 3:
        look_for_boards();
        break;
    default:
        talk_to(&bare, NULL);
        break;
    }
    return 0;
}

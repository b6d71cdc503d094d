/* The host's side of the wire protocol (docs/protocol.md): requests and their answers over any link
 * that carries bytes, and the slots of the board interface that follow from them. A back end
 * supplies the link and its own open and close; the rest is here.
 *
 * One thread at a time. Nothing here allocates, locks or prints.
 */
#ifndef MECHKIT_DRIVER_WIRE_H
#define MECHKIT_DRIVER_WIRE_H

#include "driver/protocol.h"
#include "mechkit/board.h"

/* Longest wait for the answer to an exchange: of the loop's five failures in a row the last is
 * known before the board's watchdog bites. */
#define MK_WIRE_EXCHANGE_NS 3500000

/* A way for bytes to the board and back. Deadlines are absolute, CLOCK_MONOTONIC ns. Both return
 * MK_OK; MK_ERR_TIMEOUT; MK_ERR_PROTO (something got lost on the way, the next may work); or
 * MK_ERR_NODEV (gone for good). */
struct mk_link_ops {
    enum mk_status (*send)(void *link, const uint8_t *bytes, size_t n, int64_t deadline_ns);
    /* One byte or more; they stay valid until the next call of either. */
    enum mk_status (*receive)(void *link, const uint8_t **bytes, size_t *n, int64_t deadline_ns);
};

struct mk_wire {
    const struct mk_link_ops *ops;
    void *link;
    struct mk_decoder decoder;
    const uint8_t *rest; /* bytes received and not decoded yet */
    size_t rest_size;
    uint32_t sequence;
    bool gone;
    bool unanswered;         /* the newest request that waited for an answer got none in time */
    struct mk_error trouble; /* why the newest request failed */

    struct mk_board_identity identity; /* from HELLO */
    uint32_t capabilities;             /* enum mk_wire_capability */
    double u_max;                      /* the board's own limit, command units */

    struct mk_clock *clock; /* the board's clock follows it, in steps; NULL: it runs by itself */
    int64_t ahead_ns;       /* the board's clock minus that one */
    int64_t at_ns;          /* where the board's clock stands */

    uint32_t stream_us; /* the board samples by its own clock; 0: when it is asked */
    uint32_t newest;    /* number of the newest of its samples */
    bool any;           /* there has been one */
    int64_t next_ns;    /* board's clock at the next, where it follows ours */
};

struct mk_wire_reading {
    struct mk_board_sample sample;
    uint16_t status; /* enum mk_wire_status, all of it */
    uint16_t fault;  /* enum mk_wire_fault */
};

struct mk_wire_state {
    uint16_t status, fault;
    uint64_t fault_ns, now_ns;
    uint32_t broken, stale, repeated, bites, exchanges, recorded;
    uint8_t switches, controller, phase;
};

/* Greets the board: motor off, sequence numbers anew, identity known from here on. MK_ERR_TIMEOUT,
 * MK_ERR_PROTO, MK_ERR_NODEV, MK_ERR_NOTSUP (another protocol version). Up to 1 s. */
enum mk_status mk_wire_open(struct mk_wire *w, const struct mk_link_ops *ops, void *link,
                            struct mk_error *err);

/* From here on the board's clock follows `clock`, a simulated one: each request is preceded by a
 * step to the time it happens at, and waits for as long as a simulation may take. MK_ERR_NOTSUP:
 * the board does not say that it is simulated. */
enum mk_status mk_wire_follow(struct mk_wire *w, struct mk_clock *clock, struct mk_error *err);

/* One request with its answer, tried up to `tries` times. *answer (may be NULL) is valid until the
 * next call. Refusals come back as MK_ERR_RANGE, MK_ERR_STATE, MK_ERR_NOTSUP or MK_ERR_PROTO. */
enum mk_status mk_wire_request(struct mk_wire *w, enum mk_message type, const uint8_t *payload,
                               size_t length, int tries, int64_t timeout_ns,
                               struct mk_frame *answer);

enum mk_status mk_wire_exchange(struct mk_wire *w, double u, struct mk_wire_reading *out);
enum mk_status mk_wire_state(struct mk_wire *w, struct mk_wire_state *out, struct mk_error *err);
enum mk_status mk_wire_clear(struct mk_wire *w, struct mk_error *err);
enum mk_status mk_wire_lcd(struct mk_wire *w, unsigned row, const char *text, struct mk_error *err);
enum mk_status mk_wire_leds(struct mk_wire *w, uint8_t mask, struct mk_error *err);

/* The board samples by its own clock (0: no longer). */
enum mk_status mk_wire_stream(struct mk_wire *w, uint32_t period_us, struct mk_error *err);
/* The next streamed sample, and its number; the wait is up to the caller. */
enum mk_status mk_wire_next_sample(struct mk_wire *w, int64_t timeout_ns, uint32_t *number,
                                   struct mk_wire_reading *out);
enum mk_status mk_wire_answer_sample(struct mk_wire *w, uint32_t number, double u);

/* Stand-alone control by the board (enum mk_controller): choose, give gains, start, halt, fetch
 * what was recorded. */
struct mk_standalone_record;
enum mk_status mk_wire_setup(struct mk_wire *w, int controller, uint32_t period_us,
                             unsigned record_every, int *gains, struct mk_error *err);
enum mk_status mk_wire_gains(struct mk_wire *w, int first, const float *value, int n,
                             struct mk_error *err);
enum mk_status mk_wire_start(struct mk_wire *w, struct mk_error *err);
enum mk_status mk_wire_halt(struct mk_wire *w, struct mk_error *err);
/* Fetches records from number `first` on, at most `max`; *got is 0 at the end. */
enum mk_status mk_wire_upload(struct mk_wire *w, uint32_t first, struct mk_standalone_record *out,
                              int max, int *got, struct mk_error *err);

const char *mk_wire_fault_text(uint16_t fault);

/* --- slots of the board interface; board->priv begins with a struct mk_wire --------------------
 */

/* The protocol behind a board, for what the board interface has no slot for; NULL when the board
 * does not speak it. */
struct mk_wire *mk_wire_of(struct mk_board *board);
/* Checks that board and model agree on the command's limit. */
enum mk_status mk_wire_check_model(const struct mk_wire *w, const struct mk_model *model,
                                   struct mk_error *err);
enum mk_status mk_wire_board_identify(struct mk_board *board, struct mk_board_identity *out,
                                      struct mk_error *err);
enum mk_status mk_wire_board_zero(struct mk_board *board, struct mk_error *err);
enum mk_status mk_wire_board_exchange(struct mk_board *board, double u,
                                      struct mk_board_sample *out);
enum mk_status mk_wire_board_stream(struct mk_board *board, uint32_t period_us,
                                    struct mk_error *err);
enum mk_status mk_wire_board_safe(struct mk_board *board);
enum mk_status mk_wire_board_watchdog(struct mk_board *board, unsigned timeout_ms,
                                      struct mk_error *err);
enum mk_status mk_wire_board_follow(struct mk_board *board, struct mk_error *err);

/* The slots that all boards behind the wire protocol share (struct mk_board_ops). */
/* clang-format off */
#define MK_WIRE_BOARD_SLOTS                                                                        \
    .identify = mk_wire_board_identify,                                                            \
    .zero_counters = mk_wire_board_zero,                                                           \
    .exchange = mk_wire_board_exchange,                                                            \
    .stream = mk_wire_board_stream,                                                                \
    .safe_state = mk_wire_board_safe,                                                              \
    .set_watchdog = mk_wire_board_watchdog
/* clang-format on */

#endif

/* The line between an emulated bus and the board behind it, with a plan of faults: what goes wrong
 * with request number n, or with the answer to it. A request is what the host sends at once. */
#ifndef MECHKIT_TESTS_EMU_LINE_H
#define MECHKIT_TESTS_EMU_LINE_H

#include "driver/emulated.h"

#define EMU_FAULTS(X)                                                                              \
    X(LOSE_REQUEST, "request lost")                                                                \
    X(LOSE_ANSWER, "answer lost")                                                                  \
    X(SHORT_REQUEST, "request cut short")                                                          \
    X(SHORT_ANSWER, "answer cut short")                                                            \
    X(STALL_OUT, "stall out")                                                                      \
    X(STALL_IN, "stall in")                                                                        \
    X(BLOCK_OUT, "request not taken")                                                              \
    X(LATE_ANSWER, "answer after the next request")                                                \
    X(OVERFLOW, "overflow")                                                                        \
    X(GARBAGE, "garbage before the answer")                                                        \
    X(FLIP_REQUEST, "a bit of the request flips")                                                  \
    X(FLIP_ANSWER, "a bit of the answer flips")                                                    \
    X(ERROR_OUT, "bus error out")                                                                  \
    X(ERROR_IN, "bus error in")                                                                    \
    X(TWICE_REQUEST, "request twice")                                                              \
    X(TWICE_ANSWER, "answer twice")                                                                \
    X(REORDER, "request overtaken by the next")                                                    \
    X(UNPLUG, "unplugged")

enum emu_fault {
    EMU_FAULT_NONE,
#define EMU_FAULT_ENUM(name, text) EMU_FAULT_##name,
    EMU_FAULTS(EMU_FAULT_ENUM)
#undef EMU_FAULT_ENUM
        EMU_FAULT_COUNT
};
const char *emu_fault_text(enum emu_fault fault);

/* Where the bytes go. */
struct emu_board {
    void *ctx;
    void (*receive)(void *ctx, const uint8_t *bytes, size_t n);
    size_t (*take)(void *ctx, uint8_t *bytes, size_t size);
};
struct emu_board emu_board_of(struct mk_emulated *board);

#define EMU_CHUNKS 16
#define EMU_CHUNK_SIZE (2 * MK_FRAME_MAX)

struct emu_chunk {
    uint8_t bytes[EMU_CHUNK_SIZE];
    size_t size;
    enum emu_fault fault; /* for the bus to act out: STALL_IN, OVERFLOW, ERROR_IN */
};

struct emu_line {
    struct emu_board board;
    enum emu_fault fault; /* the plan: `count` requests from number `first` on */
    unsigned first, count, requests;
    unsigned injected;
    struct emu_chunk chunk[EMU_CHUNKS]; /* from the board, oldest first */
    int chunks;
    uint8_t kept[EMU_CHUNK_SIZE]; /* the request that the next one overtakes */
    size_t kept_size;
};

/* A plan, counted from now. */
void emu_line_arm(struct emu_line *l, enum emu_fault fault, unsigned first, unsigned count);
/* A request is about to be sent: what the plan has for it. STALL_OUT, ERROR_OUT, BLOCK_OUT and
 * UNPLUG are the bus's to act out; for all others the request goes on to emu_line_send. */
enum emu_fault emu_line_fault(struct emu_line *l);
void emu_line_send(struct emu_line *l, const uint8_t *bytes, size_t n, enum emu_fault fault);
/* Takes over what the board says of its own accord. */
void emu_line_collect(struct emu_line *l, enum emu_fault fault);
/* The oldest chunk that may be read now; NULL: nothing yet. */
struct emu_chunk *emu_line_next(struct emu_line *l);
void emu_line_drop(struct emu_line *l);

#endif

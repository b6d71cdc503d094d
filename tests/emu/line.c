#include "emu/line.h"

#include <string.h>

const char *emu_fault_text(enum emu_fault fault)
{
    static const char *const text[] = {"none",
#define EMU_FAULT_TEXT(name, text) text,
                                       EMU_FAULTS(EMU_FAULT_TEXT)
#undef EMU_FAULT_TEXT
    };
    return text[fault];
}

static void emulated_receive(void *ctx, const uint8_t *bytes, size_t n)
{
    (void)mk_emulated_receive(ctx, bytes, n);
}

static size_t emulated_take(void *ctx, uint8_t *bytes, size_t size)
{
    return mk_emulated_take(ctx, bytes, size);
}

struct emu_board emu_board_of(struct mk_emulated *board)
{
    return (struct emu_board){board, emulated_receive, emulated_take};
}

void emu_line_arm(struct emu_line *l, enum emu_fault fault, unsigned first, unsigned count)
{
    l->fault = fault;
    l->first = first;
    l->count = count;
    l->requests = l->injected = 0;
}

enum emu_fault emu_line_fault(struct emu_line *l)
{
    unsigned n = l->requests++;
    for (int i = 0; i < l->chunks; i++) /* late answers may come now */
        if (l->chunk[i].fault == EMU_FAULT_LATE_ANSWER)
            l->chunk[i].fault = EMU_FAULT_NONE;
    if (l->fault == EMU_FAULT_NONE || n < l->first || n - l->first >= l->count)
        return EMU_FAULT_NONE;
    l->injected++;
    return l->fault;
}

/* --- answers -------------------------------------------------------------------------------------
 */

static void add_chunk(struct emu_line *l, const uint8_t *bytes, size_t n, enum emu_fault fault)
{
    if (l->chunks == EMU_CHUNKS || n == 0)
        return;
    struct emu_chunk *c = &l->chunk[l->chunks++];
    memcpy(c->bytes, bytes, n);
    c->size = n;
    c->fault = fault;
}

void emu_line_collect(struct emu_line *l, enum emu_fault fault)
{
    uint8_t bytes[EMU_CHUNK_SIZE];
    size_t n = l->board.take(l->board.ctx, bytes + 32, MK_FRAME_MAX);
    for (int i = 0; i < 32; i++)
        bytes[i] = (uint8_t)(37 * i + 11);
    if (n == 0 || fault == EMU_FAULT_LOSE_ANSWER)
        return;
    if (fault == EMU_FAULT_FLIP_ANSWER)
        bytes[32 + n / 2] ^= 0x10;
    if (fault == EMU_FAULT_SHORT_ANSWER)
        n /= 2;
    if (fault == EMU_FAULT_GARBAGE)
        add_chunk(l, bytes, n + 32, fault);
    else
        add_chunk(l, bytes + 32, n, fault);
    if (fault == EMU_FAULT_TWICE_ANSWER)
        add_chunk(l, bytes + 32, n, fault);
}

struct emu_chunk *emu_line_next(struct emu_line *l)
{
    bool late = l->chunks > 0 && l->chunk[0].fault == EMU_FAULT_LATE_ANSWER;
    return l->chunks > 0 && !late ? &l->chunk[0] : NULL;
}

void emu_line_drop(struct emu_line *l)
{
    l->chunks--;
    memmove(l->chunk, l->chunk + 1, (size_t)l->chunks * sizeof l->chunk[0]);
}

/* --- requests ------------------------------------------------------------------------------------
 */

static void deliver(struct emu_line *l, const uint8_t *bytes, size_t n, enum emu_fault fault)
{
    uint8_t changed[EMU_CHUNK_SIZE];
    memcpy(changed, bytes, n);
    if (fault == EMU_FAULT_FLIP_REQUEST)
        changed[n / 2] ^= 0x10;
    if (fault == EMU_FAULT_SHORT_REQUEST)
        n /= 2;
    l->board.receive(l->board.ctx, changed, n);
    if (fault == EMU_FAULT_TWICE_REQUEST)
        l->board.receive(l->board.ctx, changed, n);
    emu_line_collect(l, fault);
}

void emu_line_send(struct emu_line *l, const uint8_t *bytes, size_t n, enum emu_fault fault)
{
    if (fault == EMU_FAULT_LOSE_REQUEST)
        return;
    if (fault == EMU_FAULT_REORDER) {
        memcpy(l->kept, bytes, n);
        l->kept_size = n;
        return;
    }
    deliver(l, bytes, n, fault);
    if (l->kept_size > 0)
        deliver(l, l->kept, l->kept_size, EMU_FAULT_NONE);
    l->kept_size = 0;
}

/* A board at the far end of a TCP connection or of a pseudo-terminal, with a plan of faults. Socket
 * and terminal are the kernel's own; the board lives on the thread of whoever waits for it, by the
 * pump of emu/node.h, so that what it says is there when the wait begins, on a busy machine too.
 */
#ifndef MECHKIT_TESTS_EMU_STREAM_H
#define MECHKIT_TESTS_EMU_STREAM_H

#include <pthread.h>
#include <stdbool.h>

#include "emu/line.h"

enum emu_stream_kind { EMU_TCP, EMU_PTY };

struct emu_stream {
    enum emu_stream_kind kind;
    struct emu_line line;
    struct mk_emulated *timed; /* for streaming: whose time passes while a caller waits; or NULL */
    char device[80];           /* as --device takes it; a new pseudo-terminal has the old name */
    size_t cut;                /* bytes of an answer that can be read at once; 0: all */

    pthread_mutex_t lock;
    bool plugged;
    int listening;                   /* TCP */
    int fd;                          /* the board's end; -1: nobody is connected */
    uint8_t heard[4 * MK_FRAME_MAX]; /* from the host, not a whole frame yet, or not taken */
    size_t heard_size;
    bool blocked; /* the first frame heard is not taken before .. */
    int64_t blocked_until_ns;
};

/* One at a time in a process. */
void emu_stream_init(struct emu_stream *s, enum emu_stream_kind kind, struct emu_board board);
void emu_stream_free(struct emu_stream *s);
void emu_stream_plug(struct emu_stream *s);
/* The other end closes, and nobody is there any more. */
void emu_stream_unplug(struct emu_stream *s);

#endif

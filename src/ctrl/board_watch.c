/* See board_watch.h. All of this file is RT. */
#include "ctrl/board_watch.h"

#include <math.h>
#include <string.h>

/* Commands travel in millionths. */
#define COMMAND_RESOLUTION 2e-6

/* The board's clock is held against the host's over so long, and may run so much slower or faster,
 * beyond what the time of an exchange may jitter by. */
#define CLOCK_NS 100000000
#define CLOCK_SLOWEST 0.5
#define CLOCK_FASTEST 2.0
#define JITTER_NS 20000000

void mk_board_watch_reset(struct mk_board_watch *w, bool streaming, int limit)
{
    memset(w, 0, sizeof *w);
    w->limit = limit;
    w->sent_count = streaming ? MK_BOARD_WATCH_SENT : 1;
}

/* Less than what was sent is a limit of the board, its watchdog, or its fault, and does no harm. */
bool mk_board_watch_obeys(double sent, double applied)
{
    return applied <= fmax(sent, 0.0) + COMMAND_RESOLUTION &&
           applied >= fmin(sent, 0.0) - COMMAND_RESOLUTION;
}

static void remember(struct mk_board_watch *w, double sent)
{
    memmove(w->sent + 1, w->sent, sizeof w->sent - sizeof w->sent[0]);
    w->sent[0] = sent;
}

static bool obeys(struct mk_board_watch *w, double sent, double applied)
{
    remember(w, sent);
    double low = 0.0, high = 0.0;
    for (int i = 0; i < w->sent_count; i++) {
        low = fmin(low, w->sent[i]);
        high = fmax(high, w->sent[i]);
    }
    return mk_board_watch_obeys(high, applied) || mk_board_watch_obeys(low, applied);
}

void mk_board_watch_miss(struct mk_board_watch *w, double sent)
{
    remember(w, sent);
}

/* Every exchange is one more, and takes time. */
static bool goes_on(const struct mk_board_watch *w, const struct mk_board_watch_sample *s)
{
    uint32_t step = s->reading->sequence - w->sequence;
    return step >= 1 && step <= 1u + s->unseen && s->reading->board_ns > w->board_ns;
}

static bool clocks_agree(struct mk_board_watch *w, const struct mk_board_watch_sample *s)
{
    double host_ns = (double)(s->host_ns - w->since_host_ns);
    double board_ns = (double)s->reading->board_ns - (double)w->since_board_ns;
    if (host_ns < CLOCK_NS)
        return board_ns <= CLOCK_FASTEST * CLOCK_NS + JITTER_NS;
    w->since_host_ns = s->host_ns;
    w->since_board_ns = s->reading->board_ns;
    return board_ns >= CLOCK_SLOWEST * host_ns - JITTER_NS &&
           board_ns <= CLOCK_FASTEST * host_ns + JITTER_NS;
}

enum mk_fault mk_board_watch_step(struct mk_board_watch *w, const struct mk_board_watch_sample *s)
{
    enum mk_fault fault = MK_FAULT_NONE;
    if (!w->primed) {
        w->since_host_ns = s->host_ns;
        w->since_board_ns = s->reading->board_ns;
    } else {
        bool strange = !goes_on(w, s);
        w->strange = mk_safety_level(w->strange, strange, MK_SAFETY_RISE_LOST);
        if (!clocks_agree(w, s))
            w->strange += MK_BOARD_CLOCK_WEIGHT * MK_SAFETY_RISE_LOST;
        if (w->strange >= w->limit * MK_SAFETY_RISE_LOST)
            fault = MK_FAULT_STALE;
    }
    w->primed = true;
    w->sequence = s->reading->sequence;
    w->board_ns = s->reading->board_ns;
    bool listens = !(s->reading->status & MK_BOARD_ST_OWN);
    return obeys(w, s->sent, s->reading->u_applied) && listens ? fault : MK_FAULT_DISOBEYED;
}

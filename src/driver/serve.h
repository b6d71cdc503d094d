/* A virtual rig behind the wire protocol: an emulated board (emulated.h) at the end of a TCP
 * connection or of a pseudo-terminal, for a program that must not know what it drives.
 *
 * It behaves as a board: one client at a time, motor off when it hangs up, by its own watchdog when
 * it stays silent; the rig goes on between two clients. Its clock may be stepped. One thread; ends
 * when *stop is set.
 */
#ifndef MECHKIT_DRIVER_SERVE_H
#define MECHKIT_DRIVER_SERVE_H

#include "driver/emulated.h"

#define MK_SERVE_PTY "pty" /* where to listen: a new pseudo-terminal */

struct mk_serve_config {
    const struct mk_model *model; /* copied */
    uint64_t seed;                /* of its noise */
    const char *listen;           /* HOST:PORT (0: any), or MK_SERVE_PTY */
    bool once;                    /* ends when the first client has gone */
    volatile int *stop;           /* set from outside; may be NULL */
    /* What happens, a line each; may be NULL. */
    void (*say)(void *user, const char *line);
    void *user;
};

struct mk_server;

/* Listens from here on; clients are kept waiting until mk_serve_run. MK_ERR_USAGE (an address that
 * is none), MK_ERR_BUSY (the port is taken), ... */
MK_NODISCARD enum mk_status mk_serve_open(const struct mk_serve_config *config,
                                          struct mk_server **out, struct mk_error *err);
/* What --board and --device take to get there. */
const char *mk_serve_board(const struct mk_server *s);
const char *mk_serve_device(const struct mk_server *s);
/* Tests: the board that is served; borrowed, on the thread of mk_serve_run. */
struct mk_emulated *mk_serve_emulated(struct mk_server *s);
MK_NODISCARD enum mk_status mk_serve_run(struct mk_server *s, struct mk_error *err);
void mk_serve_close(struct mk_server *s); /* motor off; NULL allowed */

#endif

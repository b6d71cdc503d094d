/* TCP: addresses as text, connections to a board, and the listening side of a served one. All
 * descriptors that come from here do not block and send what they are given at once (TCP_NODELAY).
 */
#ifndef MECHKIT_DRIVER_TCP_H
#define MECHKIT_DRIVER_TCP_H

#include <stdbool.h>

#include "mechkit/status.h"

#define MK_TCP_CONNECT_S 3 /* longest wait for a connection */

struct mk_tcp_address {
    char host[256]; /* a name, an IPv4 address, or an IPv6 address without its brackets */
    char port[6];
};

/* HOST:PORT, IPv6 as [ADDRESS]:PORT. `any_port`: 0 is a port as well. MK_ERR_USAGE. */
MK_NODISCARD enum mk_status mk_tcp_parse(const char *text, bool any_port,
                                         struct mk_tcp_address *out, struct mk_error *err);

/* Connects within MK_TCP_CONNECT_S, in which the address of a name must be found too. MK_ERR_USAGE,
 * MK_ERR_NOTFOUND (nobody there), MK_ERR_TIMEOUT, ..., with what to do. */
MK_NODISCARD enum mk_status mk_tcp_connect(const char *device, int *fd, struct mk_error *err);

/* Listens; `bound` gets the address with the port that it has become. */
MK_NODISCARD enum mk_status mk_tcp_listen(const char *where, int *fd, char *bound, size_t size,
                                          struct mk_error *err);
/* The next client that has come; -1 (errno) when none has. `peer`: its address as text. */
int mk_tcp_accept(int listening, char *peer, size_t size);

#endif

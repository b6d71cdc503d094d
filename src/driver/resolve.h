/* From names to addresses, within a time: the system's resolver knows none, and asks servers that
 * may not answer. */
#ifndef MECHKIT_DRIVER_RESOLVE_H
#define MECHKIT_DRIVER_RESOLVE_H

#include <netdb.h>
#include <stdint.h>

/* getaddrinfo for TCP with a numeric port, until `deadline_ns` (CLOCK_MONOTONIC): 0, or its error;
 * EAI_AGAIN when the time is over. Addresses in numbers need no resolver and no time. */
int mk_resolve(const char *host, const char *port, int flags, int64_t deadline_ns,
               struct addrinfo **out);

#endif

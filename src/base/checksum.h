/* A checksum of what lies in a file of ours. */
#ifndef MECHKIT_BASE_CHECKSUM_H
#define MECHKIT_BASE_CHECKSUM_H

#include <stddef.h>
#include <stdint.h>

/* CRC-32/ISO-HDLC (0xcbf43926 for "123456789"), by zlib. Frames on the wire have one of their own
 * (driver/frame.h), small enough for a microcontroller. */
uint32_t mk_checksum(const void *data, size_t size);

#endif

/* Messages of the wire protocol: types and layouts of payloads (docs/protocol.md). Shared by the
 * host's and the board's side; portable C. Offsets are in bytes from the start of the payload. */
#ifndef MECHKIT_DRIVER_PROTOCOL_H
#define MECHKIT_DRIVER_PROTOCOL_H

#include <stdint.h>

#include "driver/frame.h"

#define MK_WIRE_JOINTS 2

/* Commands travel in millionths of a command unit: exact to count with, and never "not a number".
 */
#define MK_WIRE_MICRO 1000000
#define MK_WIRE_U_MAX 2147 /* largest command, command units */

enum mk_message {
    MK_MSG_HELLO = 0x01,    /* who is there; motor off, sequence numbers begin anew */
    MK_MSG_ZERO = 0x02,     /* zero the counters */
    MK_MSG_WATCHDOG = 0x03, /* set and clear the watchdog */
    MK_MSG_EXCHANGE = 0x04, /* command out, readings in */
    MK_MSG_SAFE = 0x05,     /* motor off */
    MK_MSG_CLEAR = 0x06,    /* acknowledge latched faults */
    MK_MSG_STATE = 0x07,    /* fault with its time, error counters, switches */
    MK_MSG_LCD = 0x08,
    MK_MSG_LEDS = 0x09,
    MK_MSG_STREAM = 0x0a,  /* the board samples by its own clock */
    MK_MSG_COMMAND = 0x0b, /* the host's answer to a streamed sample; acts with the next one */
    MK_MSG_STEP = 0x0c,    /* a simulated board's clock goes on to a time, and stands */
    MK_MSG_SETUP = 0x10,   /* stand-alone: choose a controller */
    MK_MSG_GAINS = 0x11,
    MK_MSG_START = 0x12,
    MK_MSG_HALT = 0x13,
    MK_MSG_UPLOAD = 0x14, /* recorded arrays */

    MK_MSG_ANSWER = 0x80,  /* added to the type of the request */
    MK_MSG_SAMPLE = 0xc0,  /* streamed: as the answer to EXCHANGE; sequence is the sample's */
    MK_MSG_REFUSED = 0xff, /* request type, reason */
};

enum mk_refusal {
    MK_REFUSED_VERSION = 1, /* another protocol version; the third byte says which */
    MK_REFUSED_UNKNOWN = 2, /* no such message */
    MK_REFUSED_LENGTH = 3,
    MK_REFUSED_RANGE = 4,  /* a value is out of range */
    MK_REFUSED_STATE = 5,  /* not now */
    MK_REFUSED_NOTSUP = 6, /* this board has none */
};

/* Capabilities in the answer to HELLO. */
enum mk_wire_capability {
    MK_WIRE_CAP_WATCHDOG = 1,
    MK_WIRE_CAP_STREAM = 2,
    MK_WIRE_CAP_LCD = 4,
    MK_WIRE_CAP_LEDS = 8,
    MK_WIRE_CAP_DIP = 16,
    MK_WIRE_CAP_STANDALONE = 32,
    MK_WIRE_CAP_STEP = 64, /* simulated: the host may step its clock */
};

/* Status bits of readings; the first three are those of mk_board_sample. */
enum mk_wire_status {
    MK_WIRE_ST_WATCHDOG = 1,
    MK_WIRE_ST_SATURATED = 2,
    MK_WIRE_ST_FAULT = 4,
    MK_WIRE_ST_STREAMING = 8,
    MK_WIRE_ST_STANDALONE = 16, /* the board's own controller runs */
};

/* Why the board has switched its motor off. Codes from 64 on are the electronics' own. */
enum mk_wire_fault {
    MK_WIRE_FAULT_NONE = 0,
    MK_WIRE_FAULT_WATCHDOG = 1, /* no exchange in time */
    MK_WIRE_FAULT_LINE = 2,     /* too many broken frames */
    MK_WIRE_FAULT_STREAM = 3,   /* the host did not keep up with the samples */
    MK_WIRE_FAULT_TRAVEL = 4,   /* stand-alone: a joint beyond its limit */
    MK_WIRE_FAULT_COMMAND = 5,  /* stand-alone: the controller gave no number */
    MK_WIRE_FAULT_AMPLIFIER = 64,
};

/* HELLO's answer. Texts are padded with zeros; no zero at the end when full. */
#define MK_HELLO_VERSION 0      /* u8 */
#define MK_HELLO_COUNTER_BITS 1 /* u8 */
#define MK_HELLO_ENCODERS 2     /* u8 */
#define MK_HELLO_CAPABILITIES 4 /* u32 */
#define MK_HELLO_CPR 8          /* i32[2]; 0: the board does not know */
#define MK_HELLO_U_MAX 16       /* i32, micro */
#define MK_HELLO_PRODUCT 20     /* char[24] */
#define MK_HELLO_FIRMWARE 44    /* char[24] */
#define MK_HELLO_SERIAL 68      /* char[24] */
#define MK_HELLO_TEXT 24
#define MK_HELLO_SIZE 92

/* EXCHANGE and COMMAND (behind u32 sample): i32 command, micro. An EXCHANGE with a board that is
 * stepped goes on with u64 ns, the time at which it happens. The answer, and SAMPLE: */
#define MK_EXCHANGE_SIZE 4
#define MK_EXCHANGE_AT_SIZE 12
#define MK_READING_COUNT 0      /* i32[2] */
#define MK_READING_TIME 8       /* u64, ns of the board's clock when the counters were latched */
#define MK_READING_APPLIED 16   /* i32 micro, in force from then on */
#define MK_READING_STATUS 20    /* u16 */
#define MK_READING_FAULT 22     /* u16 */
#define MK_READING_EXCHANGES 24 /* u32, this one not counted */
#define MK_READING_SIZE 28

/* STATE's answer. */
#define MK_STATE_STATUS 0      /* u16 */
#define MK_STATE_FAULT 2       /* u16 */
#define MK_STATE_FAULT_TIME 4  /* u64 ns */
#define MK_STATE_TIME 12       /* u64 ns, now */
#define MK_STATE_BROKEN 20     /* u32 frames that failed a check */
#define MK_STATE_STALE 24      /* u32 requests that came after a later one */
#define MK_STATE_REPEATED 28   /* u32 */
#define MK_STATE_BITES 32      /* u32 of the watchdog */
#define MK_STATE_EXCHANGES 36  /* u32 */
#define MK_STATE_RECORDED 40   /* u32 records to upload */
#define MK_STATE_SWITCHES 44   /* u8 */
#define MK_STATE_CONTROLLER 45 /* u8 */
#define MK_STATE_PHASE 46      /* u8 */
#define MK_STATE_SIZE 48

#define MK_LCD_ROWS 2
#define MK_LCD_COLUMNS 20 /* LCD: u8 row, then up to 20 characters */

#define MK_WATCHDOG_MAX_MS 60000
#define MK_WATCHDOG_DEFAULT_MS 20 /* from HELLO until a host sets it */
#define MK_STEP_MAX_NS 1000000000 /* at a time */
#define MK_STREAM_MIN_US 250
#define MK_STREAM_MAX_US 1000000

/* UPLOAD: u32 first, u8 how many. The answer: u32 first, u8 how many, then records. */
#define MK_RECORD_SIZE 20 /* u32 sample, i32[2] counts, i32 micro, u32 phase */
#define MK_UPLOAD_HEADER 5
#define MK_UPLOAD_MAX ((MK_FRAME_PAYLOAD_MAX - MK_UPLOAD_HEADER) / MK_RECORD_SIZE)

#endif

"""The wire protocol as docs/protocol.md has it: frames, and a host that steps a simulated board.

No package beyond Python's own is needed."""
import socket
import struct
import zlib

VERSION = 1
HELLO, ZERO, WATCHDOG, EXCHANGE, SAFE, CLEAR, STATE, LCD, LEDS, STREAM, COMMAND, STEP = range(1, 13)
ANSWER, SAMPLE, REFUSED = 0x80, 0xC0, 0xFF
MICRO = 1000000


def crc16(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def encode(kind, sequence, payload=b"", version=VERSION):
    head = struct.pack("<2sBBIH", b"MK", version, kind, sequence & 0xFFFFFFFF, len(payload))
    body = head + struct.pack("<H", crc16(head)) + payload
    return body + struct.pack("<I", zlib.crc32(body))


class Decoder:
    """Finds frames in a stream that is cut anywhere. `broken` counts those that failed a check."""

    def __init__(self):
        self.data = bytearray()
        self.broken = 0

    def frames(self, data):
        """Yields (version, type, sequence, payload)."""
        self.data += data
        while True:
            at = self.data.find(b"MK")
            if at < 0:
                del self.data[:max(0, len(self.data) - 1)]
                return
            del self.data[:at]
            if len(self.data) < 12:
                return
            head = bytes(self.data[:10])
            _, version, kind, sequence, length = struct.unpack("<2sBBIH", head)
            if length > 240 or crc16(head) != struct.unpack_from("<H", self.data, 10)[0]:
                self.broken += 1
                del self.data[:1]
                continue
            if len(self.data) < 16 + length:
                return
            body = bytes(self.data[:12 + length])
            if zlib.crc32(body) != struct.unpack_from("<I", self.data, 12 + length)[0]:
                self.broken += 1
                del self.data[:1]
                continue
            del self.data[:16 + length]
            yield version, kind, sequence, body[12:]


class Host:
    """Drives a simulated board over TCP; its clock goes on as it is told to."""

    def __init__(self, device, patience=30.0):
        host, _, port = device.rpartition(":")
        self.line = socket.create_connection((host.strip("[]"), int(port)), timeout=patience)
        self.line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.decoder, self.waiting, self.sequence = Decoder(), [], 0
        hello = self.ask(HELLO)
        self.cpr = struct.unpack_from("<2i", hello, 8)
        self.ask(WATCHDOG, struct.pack("<I", 0))
        self.now = struct.unpack("<Q", self.ask(STEP, struct.pack("<Q", 0)))[0]

    def ask(self, kind, payload=b""):
        self.sequence += 1
        self.line.sendall(encode(kind, self.sequence, payload))
        while True:
            for _, answer, number, data in self.waiting:
                if number != self.sequence:
                    continue
                if answer == kind | ANSWER:
                    self.waiting = []
                    return data
                raise RuntimeError(f"the board refuses {kind:#x}: reason {data[1]}")
            data = self.line.recv(65536)
            if not data:
                raise RuntimeError("the board has hung up")
            self.waiting = list(self.decoder.frames(data))

    def exchange(self, command, period_ns):
        """Counters now; the command acts from then on. The clock then goes on."""
        micro = round(command * MICRO)
        reading = self.ask(EXCHANGE, struct.pack("<iQ", micro, self.now))
        self.now += period_ns
        return struct.unpack_from("<2i", reading, 0)

    def close(self):
        self.ask(SAFE)
        self.line.close()

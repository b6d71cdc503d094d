#!/usr/bin/env python3
"""A rig behind the wire protocol, written from docs/protocol.md and docs/theory.md alone.

usage: rig_server.py [--plant P] [--listen HOST:PORT] [--set NAME=VALUE ...] [options]

Shares nothing with mechkit but what is written there, so it tells whether that is complete; it is also a
place to start from for a simulator of one's own. Equations are integrated by Runge and Kutta's method in
steps of 1 ms at most (wheels: 0.25 ms). One client at a time, as a board. The motor is off when it hangs up, is
silent for longer than the watchdog's time, or says so. No package beyond Python's own is needed.

Friction of the joint that no motor drives: --set coulomb=LEVEL, --set viscous=COEFFICIENT. Boards differ:
--no-step (its clock cannot be stepped), --no-stream, --cpr A,B, --bits N (of its counters), --cut N (what
it sends arrives N bytes at a time), --slow MS (before each answer), --leave-after N (exchanges; it then
closes the connection, and takes the next client), --signs A,B (-1: an encoder that counts backwards), --swap
(the plugs of two encoders).
In a run, which begins when the counters are zeroed (0: before the first), somebody may be at the rig or it
may break, at times in s: --hold RUN:FROM:TO (softly, at the last joint), --dead-motor RUN[:FROM[:TO]]
(without TO for good), --loose RUN:FROM:TO:JOINT (a wire of its encoder: the counter stands still, and is right
again at the end; :lost behind it: it goes on from where it stood), --stop-clock RUN:FROM:TO (in readings).
Once: --leave RUN:AT, --reboot RUN:AT (counters, numbers and clock from 0; all but HELLO is refused), --stall
RUN:AT:SECONDS (of the wall's clock without an answer; the rig moves on for as long).
"""
import argparse
import math
import select
import socket
import struct
import time

import wire

U_MAX = 10.0
LONGEST_STEP = 1e-3  # s
WHEEL_STEP = 2.5e-4  # s: dry friction of a light wheel is stiff
WATCHDOG_FAULT, LINE_FAULT, STREAM_FAULT = 1, 2, 3
STATUS_WATCHDOG, STATUS_OTHER, STATUS_FAULT, STATUS_STREAM = 1, 2, 4, 8
UNKNOWN, LENGTH, RANGE, STATE, NONE = 2, 3, 4, 5, 6
BACKLOG = 8  # samples that may be unanswered

# --- equations: accelerations of a state, of parameters, under a command and a friction of joint 2 ------


def sign(v):
    return math.tanh(15.0 * v)


def inertia_wheel(p, q, v, u, f2):
    return ((u - p[1] * v[0] - p[2] * sign(v[0])) / p[0],)


def pendulum(p, q, v, u, f2):
    return ((u - p[2] * v[0] - p[3] * sign(v[0]) - p[1] * math.sin(q[0])) / p[0],)


def two_joints(d11, d12, d22, r1, r2):
    det = d11 * d22 - d12 * d12
    return (d22 * r1 - d12 * r2) / det, (d11 * r2 - d12 * r1) / det


def pendubot(p, q, v, u, f2):
    c2, s2, g = math.cos(q[1]), math.sin(q[1]), 9.81
    c1, c12 = math.cos(q[0]), math.cos(q[0] + q[1])
    h1 = -p[2] * s2 * (2 * v[0] * v[1] + v[1] ** 2) + g * (p[3] * c1 + p[4] * c12)
    h2 = p[2] * s2 * v[0] ** 2 + g * p[4] * c12
    return two_joints(p[0] + p[1] + 2 * p[2] * c2, p[1] + p[2] * c2, p[1],
                      u - p[5] * v[0] - p[6] * sign(v[0]) - h1, -f2(v[1]) - h2)


def reaction_wheel(p, q, v, u, f2):
    tau = u - p[3] * v[1] - p[4] * sign(v[1])
    a1 = (-p[2] * 9.81 * math.sin(q[0]) - tau - f2(v[0])) / p[0]
    return a1, tau / p[1] - a1


def furuta(p, q, v, u, f2):
    s, c = math.sin(q[1]), math.cos(q[1])
    s22 = math.sin(2 * q[1])
    h1 = 4 * p[2] * s22 * v[0] * v[1] - 0.5 * p[1] * s * v[1] ** 2
    h2 = -2 * p[2] * s22 * v[0] ** 2 - p[3] * 9.81 * s
    return two_joints(p[0] + 4 * p[2] * s * s, 0.5 * p[1] * c, 4 * p[2],
                      u - p[4] * v[0] - p[5] * sign(v[0]) - h1, -f2(v[1]) - h2)


# Law, parameters, where it hangs.
PLANTS = {
    "inertia-wheel": (inertia_wheel, [0.0047, 0.0118, 0.33], [0.0]),
    "pendulum": (pendulum, [0.0660, 7.3, 0.0105, 0.34], [0.0]),
    "pendubot": (pendubot, [0.0560, 0.0520, 0.0280, 0.81, 0.32, 0.128, 0.21], [-0.5 * math.pi, 0.0]),
    "reaction-wheel": (reaction_wheel, [0.88, 0.0047, 7.0, 0.0107, 0.33], [0.0, 0.0]),
    "furuta": (furuta, [0.0560, 0.0560, 0.0139, 0.3350, 0.1290, 0.21], [0.0, math.pi]),
}


class Rig:
    """Moves; has encoders."""

    def __init__(self, o):
        self.law, parameters, rest = PLANTS[o.plant]
        self.p = list(parameters)
        self.friction = {"coulomb": 0.0, "viscous": 0.0}
        for text in o.set:
            name, _, value = text.partition("=")
            if name in self.friction:
                self.friction[name] = float(value)
            else:
                self.p[int(name[1:]) - 1] = float(value)
        self.longest = WHEEL_STEP if "wheel" in o.plant else LONGEST_STEP
        self.cpr, self.signs, self.bits = o.cpr, o.signs, o.bits
        self.hold, self.dead_motor, self.loose = o.hold, o.dead_motor, o.loose
        self.plugs = [1, 0] if o.swap else [0, 1]
        self.rest, self.runs, self.time = rest, 0, 0.0
        self.begin()

    def begin(self):
        self.q, self.v, self.zeroed = list(self.rest), [0.0] * len(self.rest), [0, 0]
        self.stuck, self.lost = None, [0, 0]

    def within(self, run, begin, end):
        return self.runs == run and begin <= self.time < end

    def hangs_still(self):
        return max(map(abs, self.v)) < 1e-12 and self.q == self.rest

    def motor_is_dead(self):
        run, begin, end = self.dead_motor + [0.0, math.inf][len(self.dead_motor) - 1:]
        later = 0 < run < self.runs and math.isinf(end)
        return later or self.within(run, begin, end)

    def passive(self, v):
        return self.friction["viscous"] * v + self.friction["coulomb"] * sign(v)

    def derivative(self, q, v, u):
        return v, self.law(self.p, q, v, u, self.passive)

    def advance(self, seconds, u):
        steps = max(1, math.ceil(seconds / self.longest - 1e-9))
        h = seconds / steps

        def along(x, d, k):
            return [a + k * b for a, b in zip(x, d)]
        told = u
        if self.hangs_still() and told == 0.0:  # nobody pays for a rig that nobody uses
            self.time += seconds
            return
        for _ in range(steps):
            q, v = self.q, self.v
            u = 0.0 if self.motor_is_dead() else told
            v1, a1 = self.derivative(q, v, u)
            v2, a2 = self.derivative(along(q, v1, h / 2), along(v, a1, h / 2), u)
            v3, a3 = self.derivative(along(q, v2, h / 2), along(v, a2, h / 2), u)
            v4, a4 = self.derivative(along(q, v3, h), along(v, a3, h), u)
            self.q = [x + h / 6 * (a + 2 * b + 2 * c + d) for x, a, b, c, d in zip(q, v1, v2, v3, v4)]
            self.v = [x + h / 6 * (a + 2 * b + 2 * c + d) for x, a, b, c, d in zip(v, a1, a2, a3, a4)]
            self.time += h
            if self.within(*self.hold):
                self.v[-1] -= h * (5.0 * (self.q[-1] - self.rest[-1]) + 0.5 * self.v[-1]) / self.p[0]

            self.wire_of_an_encoder()

    def position(self, j):
        if j >= len(self.q):
            return 0
        return round(self.signs[j] * (self.q[j] - self.rest[j]) * self.cpr[j] / (2 * math.pi))

    def wire_of_an_encoder(self):
        """Hangs by a thread, or holds again."""
        j = self.loose.joint
        if self.within(*self.loose.when):
            if self.stuck is None:
                self.stuck = self.position(j)
        elif self.stuck is not None:
            self.lost[j] += (self.position(j) - self.stuck) * self.loose.loses
            self.stuck = None

    def counted(self, j):
        if j == self.loose.joint and self.stuck is not None:
            return self.stuck - self.lost[j]
        return self.position(j) - self.lost[j]

    def forget(self):
        self.zeroed = [self.counted(0), self.counted(1)]

    def zero(self):
        self.forget()
        self.runs, self.time = self.runs + 1, 0.0

    def counters(self):
        half = 1 << (self.bits - 1)
        return [(self.counted(j) - self.zeroed[j] + half) % (2 * half) - half for j in self.plugs]


class Refused(Exception):
    pass


class Board:
    """What docs/protocol.md says of the board's side, stand-alone control left out."""

    def __init__(self, o):
        self.o, self.rig = o, Rig(o)
        self.opened, self.now = time.monotonic_ns(), 0
        self.stepped, self.greeted = False, False
        self.wished = self.applied = 0
        self.fault = self.fault_at = 0
        self.fired = self.watched = False
        self.watchdog, self.fed = 20000000, 0
        self.exchanges = self.bites = self.late = self.repeated = self.broken = 0
        self.sequence, self.last = 0, b""
        self.period = self.stopped_at = 0
        self.decoder, self.errors = wire.Decoder(), 0
        self.out = []

    # --- the motor

    def command(self, micro):
        limit = round(U_MAX * wire.MICRO)
        self.wished = micro
        self.applied = 0 if self.fired or self.fault else max(-limit, min(limit, micro))

    def off(self):
        self.period = 0
        self.pending = 0
        self.command(0)

    def trip(self, fault):
        if not self.fault:
            self.fault, self.fault_at = fault, self.now
        self.off()

    # --- time

    def due(self):
        """When something happens by itself; None: never."""
        times = []
        commanded = self.wished or (self.period and self.pending)
        if self.watchdog and not self.fired and (self.watched or commanded):
            times.append(self.fed + self.watchdog + 1)
        if self.period:
            times.append(self.next_sample)
        return min(times) if times else None

    def run_to(self, to):
        while True:
            due = self.due()
            until = to if due is None else min(to, max(due, self.now))
            if until > self.now:
                self.rig.advance((until - self.now) * 1e-9, self.applied / wire.MICRO)
                self.now = until
            if due is None or due > to:
                return
            if self.period and self.next_sample <= self.now:
                self.sample()
            else:
                self.fired = True
                self.bites += 1
                self.trip(WATCHDOG_FAULT)

    def live(self):
        if not self.stepped:
            self.run_to(max(self.now, time.monotonic_ns() - self.opened))

    def hold(self, stepped):
        """With the first step, and when stepping ends, the simulation begins anew."""
        if stepped != self.stepped:
            self.stepped = stepped
            self.opened = time.monotonic_ns() - self.now
            self.rig.begin()

    # --- readings

    def read_clock(self):
        if not self.rig.within(*self.o.stop_clock):
            self.stopped_at = self.now
        return self.stopped_at

    def status(self):
        return (STATUS_WATCHDOG * self.fired | STATUS_OTHER * (self.applied != self.wished)
                | STATUS_FAULT * (self.fault > 1) | STATUS_STREAM * bool(self.period))

    def reading(self, micro):
        counters, latched = self.rig.counters(), self.read_clock()
        self.command(micro)
        self.exchanges += 1
        return struct.pack("<2iQiHHI", *counters, latched, self.applied, self.status(), self.fault,
                           self.exchanges - 1)

    def sample(self):
        if self.sampled - self.answered >= BACKLOG:
            self.trip(STREAM_FAULT)
            return
        self.out.append(wire.encode(wire.SAMPLE, self.sampled, self.reading(self.pending)))
        self.sampled += 1
        while self.next_sample <= self.now:
            self.next_sample += self.period

    # --- requests

    def hello(self, data):
        self.off()
        self.hold(False)
        self.greeted, self.watched, self.watchdog, self.errors = True, False, 20000000, 0
        able = 1 | 2 * (not self.o.no_stream) | 64 * (not self.o.no_step)
        cpr = [self.o.cpr[j] if j < len(self.rig.q) else 0 for j in range(2)]
        return struct.pack("<4BI3i24s24s24s", wire.VERSION, self.o.bits, len(self.rig.q), 0, able, *cpr,
                           round(U_MAX * wire.MICRO), b"rig_server", b"1", b"")

    def zero(self, data):
        self.rig.zero()
        return b""

    def set_watchdog(self, data):
        ms = struct.unpack("<I", data)[0]
        if ms > 60000:
            raise Refused(RANGE)
        self.watchdog, self.watched, self.fired, self.fed = ms * 1000000, True, False, self.now
        if self.fault == WATCHDOG_FAULT:
            self.fault = 0
        return b""

    def step_to(self, ns):
        if ns - self.now > 1000000000:
            raise Refused(RANGE)
        self.run_to(max(ns, self.now))

    def step(self, data):
        if self.o.no_step:
            raise Refused(NONE)
        self.hold(True)
        self.step_to(struct.unpack("<Q", data)[0])
        return struct.pack("<Q", self.now)

    def exchange(self, data):
        if len(data) != 4:
            if len(data) != 12 or self.o.no_step:
                raise Refused(LENGTH)
            if not self.stepped:
                raise Refused(STATE)
            self.step_to(struct.unpack_from("<Q", data, 4)[0])
        self.fed = self.now
        return self.reading(struct.unpack_from("<i", data)[0])

    def safe(self, data):
        self.off()
        return b""

    def clear(self, data):
        self.off()
        self.fault = self.fault_at = self.errors = 0
        self.fired, self.fed = False, self.now
        return b""

    def state(self, data):
        return struct.pack("<2H2Q6I4B", self.status(), self.fault, self.fault_at, self.now, self.broken,
                           self.late, self.repeated, self.bites, self.exchanges, 0, 0, 0, 0, 0)

    def stream(self, data):
        if self.o.no_stream:
            raise Refused(NONE)
        us = struct.unpack("<I", data)[0]
        if us and not 250 <= us <= 1000000:
            raise Refused(RANGE)
        self.command(0)
        self.period, self.pending, self.sampled, self.answered = us * 1000, 0, 0, 0
        self.next_sample = self.fed = self.now
        return b""

    def answer_sample(self, data):
        sample, micro = struct.unpack("<Ii", data)
        if not self.period or sample >= self.sampled:
            raise Refused(STATE)
        self.answered, self.pending, self.fed = sample + 1, micro, self.now
        return None

    def none(self, data):
        raise Refused(NONE)

    REQUESTS = {
        wire.HELLO: (hello, range(0, 17)), wire.ZERO: (zero, [0]), wire.WATCHDOG: (set_watchdog, [4]),
        wire.EXCHANGE: (exchange, range(0, 241)), wire.SAFE: (safe, [0]), wire.CLEAR: (clear, [0]),
        wire.STATE: (state, [0]), wire.LCD: (none, range(1, 22)), wire.LEDS: (none, [1]),
        wire.STREAM: (stream, [4]), wire.COMMAND: (answer_sample, [8]), wire.STEP: (step, [8]),
        0x10: (none, [8]), 0x11: (none, range(2, 241)), 0x12: (none, [0]), 0x13: (none, [0]),
        0x14: (none, [5]),
    }

    def answer(self, kind, data):
        """The answer's frame, b"" where there is none."""
        try:
            if not self.greeted and kind != wire.HELLO:
                raise Refused(STATE)
            handle, lengths = self.REQUESTS.get(kind, (None, None))
            if not handle:
                raise Refused(UNKNOWN)
            if len(data) not in lengths:
                raise Refused(LENGTH)
            payload = handle(self, data)
            return b"" if payload is None else wire.encode(kind | wire.ANSWER, self.sequence, payload)
        except Refused as why:
            return wire.encode(wire.REFUSED, self.sequence, bytes([kind, why.args[0], wire.VERSION]))

    def request(self, version, kind, sequence, data):
        ahead = (sequence - self.sequence) & 0xFFFFFFFF
        if version == wire.VERSION and self.greeted and kind != wire.HELLO:
            if ahead == 0:
                self.repeated += 1
                self.out.append(self.last)
                return
            if ahead >= 1 << 31:
                self.late += 1
                return
        self.sequence = sequence
        if version != wire.VERSION:
            self.greeted = False
            self.off()
            self.last = wire.encode(wire.REFUSED, sequence, bytes([kind, 1, wire.VERSION]))
        else:
            self.last = self.answer(kind, data)
        if self.last:
            self.out.append(self.last)

    def receive(self, data):
        self.live()
        before = self.decoder.broken
        for frame in self.decoder.frames(data):
            self.errors = max(0, self.errors - 1)
            self.request(*frame)
        if self.decoder.broken != before:
            self.broken += self.decoder.broken - before
            self.errors += 8
        if self.errors >= 64:
            self.errors = 64
            self.trip(LINE_FAULT)

    def hang_up(self):
        self.live()
        self.off()
        self.hold(False)
        self.greeted, self.watched = False, False
        self.decoder, self.out = wire.Decoder(), []

    def reboot(self):
        self.hang_up()
        self.opened, self.now, self.exchanges = time.monotonic_ns(), 0, 0
        self.rig.forget()


class Left(Exception):
    pass


def send(o, line, board):
    for frame in board.out:
        if o.slow:
            time.sleep(o.slow / 1000)
        for at in range(0, len(frame), o.cut or len(frame)):
            line.sendall(frame[at:at + (o.cut or len(frame))])
    board.out = []


def has_gone(line):
    poll = select.poll()
    poll.register(line, select.POLLRDHUP)
    return bool(poll.poll(50))


def fall_silent(o, board, line):
    before = board.applied
    board.run_to(board.now + int(o.stall[2] * 1e9))
    print("silent: command %g, was %g" % (board.applied / wire.MICRO, before / wire.MICRO), flush=True)
    until = time.monotonic() + o.stall[2]
    while time.monotonic() < until and not has_gone(line):
        pass


def trouble(o, board, line):
    """What happens once."""
    if due(o.stall, board.rig):
        fall_silent(o, board, line)
        o.stall = None
    if due(o.reboot, board.rig):
        o.reboot = None
        print("reboot: was %g" % (board.applied / wire.MICRO), flush=True)
        board.reboot()
    if due(o.leave, board.rig):
        o.leave = None
        raise Left


def due(moment, rig):
    return moment is not None and rig.within(moment[0], moment[1], math.inf)


def serve_one(o, board, line):
    """Until the client has gone, or is left."""
    line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    until = board.exchanges + o.leave_after if o.leave_after else None
    while True:
        board.live()
        at = None if board.stepped else board.due()
        wait = 0.05 if at is None else min(0.05, max(0.0, (at - board.now) * 1e-9))
        if select.select([line], [], [], wait)[0]:
            data = line.recv(65536)
            if not data:
                return
            board.receive(data)
        board.live()
        trouble(o, board, line)
        send(o, line, board)
        if until is not None and board.exchanges >= until:
            o.leave_after = 0
            raise Left


def moment(text):
    return [float(x) for x in text.split(":")]


class Loose:
    """RUN:FROM:TO:JOINT[:lost]"""

    def __init__(self, text="-1:0:0:1"):
        parts = text.split(":")
        self.when, self.joint = [float(x) for x in parts[:3]], int(parts[3]) - 1
        self.loses = parts[4:] == ["lost"]


def pair(text):
    values = [int(x) for x in text.split(",")]
    return (values * 2)[:2]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plant", choices=PLANTS, default="pendulum")
    parser.add_argument("--listen", default="127.0.0.1:0")
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--cpr", type=pair, default=[4000, 4000])
    parser.add_argument("--signs", type=pair, default=[1, 1])
    parser.add_argument("--bits", type=int, default=24)
    parser.add_argument("--cut", type=int, default=0)
    parser.add_argument("--slow", type=float, default=0.0)
    parser.add_argument("--leave-after", type=int, default=0)
    parser.add_argument("--swap", action="store_true")
    parser.add_argument("--hold", type=moment, default=[-1, 0, 0])
    parser.add_argument("--loose", type=Loose, default=Loose())
    parser.add_argument("--stop-clock", type=moment, default=[-1, 0, 0])
    for once in ("--leave", "--reboot", "--stall"):
        parser.add_argument(once, type=moment)
    parser.add_argument("--dead-motor", type=moment, default=[-1.0])
    parser.add_argument("--no-step", action="store_true")
    parser.add_argument("--no-stream", action="store_true")
    o = parser.parse_args()
    host, _, port = o.listen.rpartition(":")
    listening = socket.create_server((host, int(port)))
    print("listening on %s:%d" % listening.getsockname()[:2], flush=True)
    board = Board(o)
    while True:
        line, _ = listening.accept()
        print("client", flush=True)
        try:
            serve_one(o, board, line)
        except (ConnectionError, Left) as why:
            print("lost:", type(why).__name__, flush=True)
        before = board.applied
        board.hang_up()
        line.close()
        print("gone: command %g, was %g" % (board.applied / wire.MICRO, before / wire.MICRO), flush=True)


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Times mechkit beside others, in one run: prints tables and writes build/bench.json.

usage: bench.py BUILD LIBRARY [SECTION...]

Sections are the rows of the table below; all of them without a name. BENCH_ROUNDS (7) is how often each
program takes its turn, BENCH_SECONDS (10) how long the loop and the wire are looked at, BENCH_CASES (2) how many cases explain gets, BENCH_LONG=1 goes up to
logs of ten million lines. Every run adds a line to BENCH_HISTORY (BUILD/bench-history.jsonl), which is
drawn as BUILD/bench-history.svg. docs/performance.md says what the figures mean.
"""
import ctypes
import json
import os
import sys

import environment

environment.prepare(sys.argv[1])

import derivatives  # noqa: E402
import growing  # noqa: E402
import history  # noqa: E402
import identify  # noqa: E402
import logs  # noqa: E402
import machine  # noqa: E402
import programs  # noqa: E402
import simulation  # noqa: E402

SECTIONS = {
    "simulation": simulation.rows,
    "held": simulation.held,
    "derivatives": derivatives.rows,
    "batches": derivatives.batches,
    "logs": logs.rows,
    "growth": growing.rows,
    "lateness": programs.lateness,
    "handover": programs.handover,
    "round_trip": programs.round_trip,
    "identify": identify.rows,
    "explain": programs.explain,
}


class Context:
    """What sections are given."""

    def __init__(self, build, library):
        self.build = build
        self.lib = ctypes.CDLL(library)
        self.seconds = int(os.environ.get("BENCH_SECONDS", "10"))
        self.cases = int(os.environ.get("BENCH_CASES", "2"))
        self.long = os.environ.get("BENCH_LONG") == "1"
        address = ctypes.c_void_p
        for name, types in {
                "bench_reference": [address], "bench_rk4": [ctypes.c_int, address],
                "bench_many": [ctypes.c_int, ctypes.c_double, address],
                "bench_held": [ctypes.c_int, ctypes.c_double, address],
                "bench_fast_held": [ctypes.c_double, address],
                "bench_angles": [address, ctypes.c_int, address],
                "bench_identify": [address, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_int,
                                   address],
                "bench_derivatives": [ctypes.c_double, address], "bench_shoot": [ctypes.c_int],
                "bench_numbers": [ctypes.c_int, ctypes.c_int, address],
                "bench_log_write": [ctypes.c_char_p, ctypes.c_int, ctypes.c_int, address],
                "bench_log_fprintf": [ctypes.c_char_p, ctypes.c_int, ctypes.c_int, address],
                "bench_log_read": [ctypes.c_char_p], "bench_hypotheses_prepare": [],
                "bench_hypotheses": [ctypes.c_int]}.items():
            getattr(self.lib, name).argtypes = types


def main():
    build, names = sys.argv[1], sys.argv[3:] or list(SECTIONS)
    unknown = [name for name in names if name not in SECTIONS]
    if unknown:
        sys.exit(f"bench: there is no section {unknown[0]}; there are {', '.join(SECTIONS)}")
    context = Context(build, sys.argv[2])
    path = os.path.join(build, "bench.json")
    met = machine.look()
    result = dict(met)
    print(f"{machine.describe(met)}; CPU times, medians")
    if met["load"] > 0.5:
        print("Something else is running: figures that it disturbs are left out.")
    for name in names:
        try:
            result[name] = SECTIONS[name](context)
        except (OSError, RuntimeError) as why:
            print(f"\n{name}: skipped: {why}")
            result[name] = {"skipped": str(why)}
        with open(path, "w", encoding="utf-8") as file:
            json.dump(result, file, indent=1)
    kept = os.environ.get("BENCH_HISTORY", os.path.join(build, "bench-history.jsonl"))
    picture = os.path.join(build, "bench-history.svg")
    history.append(kept, met, {name: result[name] for name in names})
    print(f"\nfigures: {path}\nhistory: {kept}" +
          (f", drawn: {picture}" if history.plot(kept, picture) else ""))


if __name__ == "__main__":
    main()

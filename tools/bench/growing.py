"""How cost grows: with the samples of a log, with the number of runs, with that of hypotheses."""
import ctypes
import os

import numpy as np

from harness import growth
from logs import scratch


def rows(context):
    lib = context.lib
    most = 10 ** 7 if context.long else 10 ** 6
    samples = [n for n in (10 ** 3, 10 ** 4, 10 ** 5, 10 ** 6, 10 ** 7) if n <= most]
    numbers = np.empty((most, 4))
    lib.bench_numbers(most, 4, numbers.ctypes.data)
    path = scratch(context, "growth.csv").encode()

    def write(n):
        lib.bench_log_write(path, n, 4, numbers.ctypes.data)

    def read(n):
        if getattr(read, "lines", 0) != n:
            write(n)
            read.lines = n
        lib.bench_log_read(path)

    def derivatives(n):
        if not lib.bench_shoot(n):
            raise RuntimeError("shooting failed")

    def batch(runs):
        out = np.empty((2001, 4))
        lib.bench_many(runs, ctypes.c_double(1e-8), out.ctypes.data)

    result = {"log write, lines": growth("writing a log of 4 columns, lines", samples, write),
              "log read, lines": growth("reading it, lines", samples, read),
              "shooting, samples": growth("prediction of a log with its derivatives, samples",
                                          samples, derivatives),
              "batch, runs": growth("trajectories of 10 s, runs", (1, 4, 16, 64, 256, 1000), batch)}
    there = lib.bench_hypotheses_prepare()
    if not there:
        raise RuntimeError("no model for the search of explain")
    counts = [n for n in (1, 2, 4, 8, 15, 30, 60) if n <= there]
    result["explain, hypotheses"] = growth("explain's search, hypotheses", counts,
                                           lib.bench_hypotheses)
    os.unlink(path)
    return result

"""Logs of ten columns of doubles in full precision: lines written and read."""
import os

import numpy as np

from environment import has
from harness import Program, measure, table

LINES, COLUMNS = 50000, 10


def scratch(context, name):
    return os.path.join("/dev/shm" if os.path.isdir("/dev/shm") else context.build,
                        f"mechkit-bench-{os.getpid()}-{name}")


def per_line(title, result, ours):
    for row in result.values():
        if row["ms"] is not None:
            row["lines_per_s"] = 1e3 / row["ms"]
            row["note"] = f"{1e6 * row['ms']:.0f} ns a line"
    table(title, result, ours)
    return result


def rows(context):
    lib = context.lib
    numbers = np.empty((LINES, COLUMNS))
    lib.bench_numbers(LINES, COLUMNS, numbers.ctypes.data)
    ours, text = scratch(context, "ours.csv").encode(), scratch(context, "text.csv").encode()

    def call(function, path):
        def run(_level):
            if not function(path, LINES, COLUMNS, numbers.ctypes.data):
                raise RuntimeError("writing failed")
        return run

    name = "mechkit log writer"
    writers = {name: Program(call(lib.bench_log_write, ours), per=LINES),
               "fprintf %.17g": Program(call(lib.bench_log_fprintf, text), per=LINES)}
    readers = {"mechkit log reader": Program(lambda _level: lib.bench_log_read(ours), per=LINES)}
    lib.bench_log_write(ours, LINES, COLUMNS, numbers.ctypes.data)
    if has("pandas"):
        import pandas
        frame = pandas.DataFrame(numbers, columns=["t"] + [f"c{i}" for i in range(1, COLUMNS)])
        writers["pandas to_csv"] = Program(lambda _level: frame.to_csv(text.decode(), index=False),
                                           per=LINES)
        readers["pandas read_csv"] = Program(
            lambda _level: pandas.read_csv(ours.decode(), comment="#"), per=LINES,)
        readers["pandas read_csv, exact"] = Program(
            lambda _level: pandas.read_csv(ours.decode(), comment="#",
                                           float_precision="round_trip"), per=LINES)
    result = {"write": per_line("writing a log, 10 columns, per line", measure(writers), name),
              "read": per_line("reading it, per line", measure(readers), "mechkit log reader")}
    for path in (ours, text):
        if os.path.exists(path):
            os.unlink(path)
    return result

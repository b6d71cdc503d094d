"""How everything is timed: programs in turn, round by round, by the thread's own CPU clock, so that a
busy machine falls on all of them alike. What counts are medians, and ratios within one run."""
import math
import os
import statistics
import time

ROUNDS = int(os.environ.get("BENCH_ROUNDS", "7"))
LONG_ENOUGH_S = 0.02


class Program:
    """One row of a table. `run(level)` does the work once, at a level of accuracy out of `levels`,
    loosest first; `error(result)` says how far off it is. Without levels it is timed as it is."""

    def __init__(self, run, levels=(None,), per=1, note=""):
        self.run, self.levels, self.per, self.note = run, tuple(levels), per, note


def loosest(program, error, target):
    """The first level that meets the target, and its error; a lucky one does not count: the next
    must meet it too."""
    levels = program.levels
    for i, level in enumerate(levels):
        off = error(program.run(level))
        if off <= target and (i + 1 == len(levels) or
                              error(program.run(levels[i + 1])) <= target):
            return level, off
    return None, None


def seconds_of(run, level):
    """CPU seconds of one call, by as many calls as the clock needs."""
    repeat = 1
    while True:
        start = time.thread_time()
        for _ in range(repeat):
            run(level)
        elapsed = time.thread_time() - start
        if elapsed > LONG_ENOUGH_S or repeat > 4096:
            return elapsed / repeat
        repeat *= 4


def measure(programs, error=None, target=None):
    """Rows by name: median milliseconds, and level and error where there are any."""
    settings = {}
    for name, program in programs.items():
        if error is None or len(program.levels) == 1:
            settings[name] = (program.levels[0], None)
            program.run(program.levels[0])  # warm
            continue
        level, off = loosest(program, error, target)
        if level is None:
            print(f"  {name}: left out, it does not reach an error of {target:g}")
        else:
            settings[name] = (level, off)
    times = {name: [] for name in settings}
    for _ in range(ROUNDS):
        for name, (level, _off) in settings.items():
            times[name].append(seconds_of(programs[name].run, level) / programs[name].per)
    return {name: {"ms": 1e3 * statistics.median(times[name]),
                   "low_ms": 1e3 * min(times[name]), "high_ms": 1e3 * max(times[name]),
                   "level": level, "error": off, "note": programs[name].note}
            for name, (level, off) in settings.items()}


def table(title, rows, ours, target_ms=None):
    """Prints rows, fastest first, with the ratio to `ours`."""
    print(f"\n{title}\n  {'':44s} {'ms':>10s} {'error':>9s} {'times ours':>11s}")
    for name, r in sorted(rows.items(), key=lambda item: item[1]["ms"]):
        off = f"{r['error']:9.1e}" if r["error"] is not None else " " * 9
        print(f"  {name:44s} {r['ms']:10.4f} {off} {r['ms'] / rows[ours]['ms']:11.2f}  {r['note']}")
    if target_ms:
        print(f"  target {target_ms:g} ms: {'met' if rows[ours]['ms'] <= target_ms else 'missed'}")


def exponent(sizes, seconds):
    """Slope of log(seconds) over log(size), least squares."""
    x, y = [math.log(s) for s in sizes], [math.log(s) for s in seconds]
    mx, my = statistics.fmean(x), statistics.fmean(y)
    return sum((a - mx) * (b - my) for a, b in zip(x, y)) / sum((a - mx) ** 2 for a in x)


def growth(title, sizes, run):
    """Seconds of run(size) by size, each the median of three, and the exponent of the upper half."""
    print(f"\n{title}")
    seconds = []
    for size in sizes:
        seconds.append(statistics.median(seconds_of(run, size) for _ in range(3)))
        print(f"  {size:10d} {1e3 * seconds[-1]:12.4f} ms")
    half = len(sizes) // 2
    slope = exponent(sizes[half:], seconds[half:])
    print(f"  grows as size^{slope:.2f} over the upper half")
    return {"sizes": list(sizes), "seconds": seconds, "exponent": slope}

"""How everything is timed: programs in turn, round by round, by the thread's own CPU clock, so that a
busy machine falls on all of them alike. What counts are medians, and ratios within one round. A figure
whose rounds scatter too much is not told: the machine was too noisy."""
import math
import os
import statistics
import time

ROUNDS = int(os.environ.get("BENCH_ROUNDS", "7"))
LONG_ENOUGH_S = 0.02
MOST_SCATTER = 0.10  # interquartile range of the rounds, over their median, of a figure that is told
TRIES = 3  # sets of rounds, of which the quietest counts; no further one where all is quiet


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


def scatter(values):
    """Interquartile range over the median."""
    if len(values) < 2:
        return math.inf
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
    return (high - low) / middle


def settings_of(programs, error, target):
    """By name the level at which a program is timed and its error there; warmed up."""
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
    return settings


def measure(programs, error=None, target=None):
    """Rows by name: median milliseconds (None where they scatter too much), their scatter, those of
    all rounds, and level and error where there are any."""
    settings = settings_of(programs, error, target)
    best = {}
    for _ in range(TRIES):
        times = {name: [] for name in settings}
        for _round in range(ROUNDS):
            for name, (level, _off) in settings.items():
                times[name].append(seconds_of(programs[name].run, level) / programs[name].per)
        # A set is kept whole: ratios are those of one round.
        noise = max((scatter(t) for t in times.values()), default=0.0)
        if not best or noise < best["noise"]:
            best = {"noise": noise, "times": times}
        if noise <= MOST_SCATTER:
            break
    rows = {}
    for name, (level, off) in settings.items():
        times = [1e3 * s for s in best["times"][name]]
        quiet = scatter(times) <= MOST_SCATTER
        rows[name] = {"ms": statistics.median(times) if quiet else None, "scatter": scatter(times),
                      "rounds_ms": times, "beside": sorted(settings), "level": level, "error": off,
                      "note": programs[name].note}
    return rows


def ratio(row, ours):
    """How many times as long as ours. Of programs that took turns, round by round: the median, or None
    where that scatters too much; a machine that changes its pace between rounds leaves it alone. Of
    others, of their medians, or None where one of these is not told."""
    if row["beside"] == ours["beside"]:
        ratios = [a / b for a, b in zip(row["rounds_ms"], ours["rounds_ms"])]
        return statistics.median(ratios) if scatter(ratios) <= MOST_SCATTER else None
    told = row["ms"] is not None and ours["ms"] is not None
    return row["ms"] / ours["ms"] if told else None


def cell(value, form, width):
    return f"{value:{width}{form}}" if value is not None else f"{'too noisy':>{width}s}"


def table(title, rows, ours, target_ms=None):
    """Prints rows, fastest first, with the ratio to `ours`, which is also put into them."""
    print(f"\n{title}\n  {'':44s} {'ms':>10s} {'error':>9s} {'times ours':>11s}")
    for name, r in sorted(rows.items(), key=lambda item: statistics.median(item[1]["rounds_ms"])):
        r["times_ours"] = ratio(r, rows[ours])
        off = f"{r['error']:9.1e}" if r["error"] is not None else " " * 9
        print(f"  {name:44s} {cell(r['ms'], '.4f', 10)} {off} "
              f"{cell(r['times_ours'], '.2f', 11)}  {r['note']}")
    if target_ms:
        ms = rows[ours]["ms"]
        met = "cannot be told, the machine is too noisy" if ms is None else \
            "met" if ms <= target_ms else "missed"
        print(f"  target {target_ms:g} ms: {met}")


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

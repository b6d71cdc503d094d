#!/usr/bin/env python3
"""The figures of all runs of the bench, a line of JSON each, and a plot of them.

usage: history.py HISTORY PLOT.svg

A line has what bench.py met (machine.py) and `ms`, the median by "section: program" of what was quiet
enough to tell.
"""
import json
import os
import shutil
import subprocess
import sys


def figures(result):
    """{"section: program": ms} of all rows that were quiet enough to tell, at any depth."""
    found = {}

    def look(section, value):
        if not isinstance(value, dict):
            return
        for name, row in value.items():
            if isinstance(row, dict) and row.get("ms") is not None:
                found[f"{section}: {name}"] = row["ms"]
            elif isinstance(row, dict):
                look(f"{section} {name}", row)

    for section, value in result.items():
        look(section, value)
    return found


def append(path, met, result):
    """Adds this run, in one write: two benches at once do not mix their lines."""
    line = json.dumps({**met, "ms": figures(result)}, sort_keys=True) + "\n"
    with open(path, "a", encoding="utf-8") as file:
        file.write(line)


def read(path):
    """The runs; a line that was cut short is left out, and told."""
    runs = []
    with open(path, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            try:
                run = json.loads(line)
                runs.append({"date": run["date"], "ms": dict(run["ms"])})
            except (ValueError, KeyError, TypeError):
                print(f"{path}:{number}: not a run of the bench, left out", file=sys.stderr)
    return runs


def plot(path, picture):
    """Draws milliseconds over the runs, a line for each program of ours and of its peers."""
    runs = read(path)
    names = sorted({name for run in runs for name in run["ms"]})
    if not names or not shutil.which("gnuplot"):
        return False
    quote = lambda text: '"' + text.replace("\\", "").replace('"', "") + '"'  # noqa: E731
    lines = [f"set terminal svg size 1100,{300 + 18 * len(names)} noenhanced background 'white'",
             f"set output {quote(picture)}", "set logscale y", "set key below maxcols 2",
             "set ylabel 'ms'", "set xlabel 'run'", "set grid", "set offsets 0.3, 0.3, 0, 0",
             f"set title {quote(runs[0]['date'] + ' to ' + runs[-1]['date'])}", "set xtics 1"]
    parts = [f"'-' using 1:2 with linespoints dashtype {1 if 'mechkit' in name else 3} "
             f"title {quote(name)}" for name in names]
    lines.append("plot " + ", ".join(parts))
    for name in names:
        lines += [f"{i + 1} {run['ms'][name]:.6g}" for i, run in enumerate(runs)
                  if name in run["ms"]] + ["e"]
    done = subprocess.run(["gnuplot", "-d"], input="\n".join(lines) + "\n", text=True,
                          capture_output=True, check=False)
    if done.returncode != 0 or not os.path.exists(picture):
        print(f"gnuplot could not draw {picture}: {done.stderr.strip()}", file=sys.stderr)
        return False
    return True


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    if not os.path.exists(sys.argv[1]):
        sys.exit(f"{sys.argv[1]}: there is no history yet; make bench writes it")
    sys.exit(0 if plot(sys.argv[1], sys.argv[2]) else 1)


if __name__ == "__main__":
    main()

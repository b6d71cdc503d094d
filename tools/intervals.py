#!/usr/bin/env python3
"""Counts how often `mechkit identify`'s 95 % intervals hold the true parameters.

usage: intervals.py MECHKIT [CASE...]

The cases are those of $MECHKIT_SHARED/challenge (or ../shared/challenge beside the source tree) that
hide no effect; without the folder this says so and exits 0. Fitted are their training logs, from the
given parameters. No package beyond Python's own is needed.
"""
import json
import os
import subprocess
import sys
import tempfile

from cases import cases

WITHIN = 1.959964  # standard errors: 95 %
WANTED = 0.90


def fit(mechkit, case):
    """The fit's JSON, or None and why not."""
    with tempfile.TemporaryDirectory() as scratch:
        out = os.path.join(scratch, "fit.json")
        done = subprocess.run(
            [mechkit, "identify", "--model", case.model, "--json", out] + case.train,
            capture_output=True, text=True)
        if done.returncode:
            return None, done.stderr.strip()
        with open(out) as file:
            return json.load(file), ""


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    mechkit = sys.argv[1]
    inside = count = 0
    for case in cases(sys.argv[2:]):
        if case.truth["kind"] not in ("none", "parameters"):
            continue
        if count == 0:
            print("errors of the parameters in standard errors; * outside the 95 % interval")
        result, why = fit(mechkit, case)
        cells = []
        for i, true in enumerate(case.truth["parameters"]):
            count += 1
            if result is None:
                continue
            p = result["parameters"][f"p{i + 1}"]
            z = (p["value"] - true) / p["stderr"] if p["stderr"] else float("inf")
            inside += abs(z) <= WITHIN
            cells.append(f"{z:6.2f}{' ' if abs(z) <= WITHIN else '*'}")
        print(f"{case.name} {case.truth['rig']:14} {case.truth['kind']:10} "
              f"{' '.join(cells) or why}", flush=True)
    if count == 0:
        return
    print(f"{inside} of {count} true parameters inside, {100 * inside / count:.1f} %")
    if inside < WANTED * count:
        sys.exit(f"intervals: less than {100 * WANTED:.0f} %")


if __name__ == "__main__":
    main()

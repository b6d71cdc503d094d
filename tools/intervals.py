#!/usr/bin/env python3
"""Counts how often `mechkit identify`'s 95 % intervals hold the true parameters.

usage: intervals.py MECHKIT [CASE...]

The cases are those of $MECHKIT_SHARED/challenge (or ../shared/challenge beside the source tree) that
hide no effect; without the folder this says so and exits 0. Fitted are their training logs, from the
given parameters. No package beyond Python's own is needed.
"""
import glob
import json
import os
import subprocess
import sys
import tempfile

WITHIN = 1.959964  # standard errors: 95 %
WANTED = 0.90


def fit(mechkit, folder):
    """The fit's JSON, or None and why not."""
    with tempfile.TemporaryDirectory() as scratch:
        out = os.path.join(scratch, "fit.json")
        done = subprocess.run(
            [mechkit, "identify", "--model", f"{folder}/base.ini", "--json", out]
            + sorted(glob.glob(f"{folder}/train_*")), capture_output=True, text=True)
        if done.returncode:
            return None, done.stderr.strip()
        with open(out) as file:
            return json.load(file), ""


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    mechkit, wanted = sys.argv[1], sys.argv[2:]
    here = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    shared = os.environ.get("MECHKIT_SHARED", os.path.join(here, "..", "shared"))
    folder = os.path.join(shared, "challenge")
    answers = sorted(glob.glob(f"{folder}/truth/case_*.json"))
    if not answers:
        print(f"SKIPPED: no cases with answers in {folder}")
        return
    inside = count = 0
    print("errors of the parameters in standard errors; * outside the 95 % interval")
    for path in answers:
        case = os.path.basename(path)[:-5]
        with open(path) as file:
            truth = json.load(file)
        if truth["kind"] not in ("none", "parameters") or wanted and case not in wanted:
            continue
        result, why = fit(mechkit, f"{folder}/{case}")
        cells = []
        for i, true in enumerate(truth["parameters"]):
            count += 1
            if result is None:
                continue
            p = result["parameters"][f"p{i + 1}"]
            z = (p["value"] - true) / p["stderr"] if p["stderr"] else float("inf")
            inside += abs(z) <= WITHIN
            cells.append(f"{z:6.2f}{' ' if abs(z) <= WITHIN else '*'}")
        print(f"{case} {truth['rig']:14} {truth['kind']:10} {' '.join(cells) or why}", flush=True)
    print(f"{inside} of {count} true parameters inside, {100 * inside / count:.1f} %")
    if inside < WANTED * count:
        sys.exit(f"intervals: less than {100 * WANTED:.0f} %")


if __name__ == "__main__":
    main()

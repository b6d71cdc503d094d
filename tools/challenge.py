#!/usr/bin/env python3
"""Scores `mechkit explain` on a folder of cases with answers.

usage: challenge.py MECHKIT [CASE...]

The folder is $MECHKIT_SHARED/challenge, or ../shared/challenge beside the source tree; without one
this says so and exits 0. `closed` is measured apart from what the report claims: the extended model
is simulated in windows of 1 s and compared with the noise-free angles. No package beyond Python's own
is needed.
"""
import csv
import gzip
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time

from cases import cases

TIMEOUT = 60.0  # s a case


def table(path):
    """Columns of a log by name; empty fields are NaN."""
    opener = gzip.open if path.endswith(".gz") else open
    with opener(path, "rt") as file:
        rows = csv.reader(line for line in file if not line.startswith("#"))
        names = next(rows)
        columns = {name: [] for name in names}
        for row in rows:
            for name, field in zip(names, row):
                columns[name].append(float(field) if field else math.nan)
    return columns


def closed(mechkit, case, extended):
    """How much of what a refitted base model leaves the extension takes away: -1 to 1."""
    with tempfile.TemporaryDirectory() as scratch:
        out = os.path.join(scratch, "p.csv")
        done = subprocess.run(
            [mechkit, "simulate", "--model", extended, "--window", "1.0", "--out", out,
             "--input", case.holdout], capture_output=True, text=True)
        if done.returncode:
            return -1.0
        predicted = table(out)
    truth, score = table(case.holdout_truth), case.truth["score"]
    valid = set(score["valid"])
    after = 0.0
    for joint, std in enumerate(score["std"]):
        name = f"q{joint + 1}"
        square = count = 0
        for window, p, q in zip(predicted["window"], predicted[name], truth[name]):
            if int(window) in valid and not math.isnan(p + q):
                square += (p - q) ** 2
                count += 1
        after += square / max(count, 1) / std ** 2
    floor, refit = (sum((rms / std) ** 2 for rms, std in zip(score[key], score["std"]))
                    for key in ("floor", "refit"))
    return max(-1.0, min(1.0, 1.0 - (after - floor) / (refit - floor)))


def accepted(truth):
    """By hidden effect: the names that are right for it."""
    names = [[(e["name"], e["joint"])] for e in truth["effects"]]
    for other in truth.get("accept", []):
        names[other.get("effect", 0)].append((other["name"], other.get("joint")))
    return names


def among(name, right):
    return any(name[0] == n and (joint is None or joint == name[1]) for n, joint in right)


def judge(truth, report):
    """What a report is worth: a dictionary of marks."""
    said = [(c["name"], c["joint"]) for c in report["causes"]]
    right = accepted(truth)
    tied = [(r["name"], r["joint"]) for r in report["rivals"] if not r["distinguishable"]]
    mark = {"said": said, "verdict": report["verdict"]}
    if truth["kind"] in ("none", "parameters"):
        mark["alarm"] = report["verdict"] in ("effect", "unknown")
    elif truth["kind"] == "off":
        mark["off"] = report["verdict"] == "unknown" and bool(report["structure"])
    else:
        mark["first"] = bool(said) and any(among(said[0], r) for r in right)
        mark["rival"] = mark["first"] or any(among(n, r) for n in said + tied for r in right)
        mark["both"] = all(any(among(n, r) for n in said) for r in right)
        errors = [abs(next(iter(c["parameters"].values()))["value"] /
                      next(iter(e["parameters"].values())) - 1.0)
                  for c in report["causes"] for e in truth["effects"] if c["name"] == e["name"]]
        mark["error"] = errors[0] if errors and mark["first"] else None
    return mark


def share(marks, key):
    values = [m[key] for m in marks if key in m]
    return f"{sum(values)} of {len(values)}" if values else "-"


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    mechkit = sys.argv[1]
    marks, weak = [], []
    for case in cases(sys.argv[2:]):
        truth = case.truth
        with tempfile.TemporaryDirectory() as out:
            begin = time.time()
            try:
                subprocess.run(
                    [mechkit, "explain", "--model", case.model, "--out", out, "--holdout",
                     case.holdout] + case.train, capture_output=True, text=True, timeout=TIMEOUT)
                with open(f"{out}/report.json") as file:
                    report = json.load(file)
            except (subprocess.TimeoutExpired, OSError, ValueError):
                report = {"verdict": "FAILED", "causes": [], "rivals": [], "structure": ""}
            mark = judge(truth, report)
            mark["seconds"] = time.time() - begin
            hidden = [e["name"] for e in truth["effects"]]
            if hidden and "missed-counts" not in hidden and report["verdict"] != "FAILED":
                mark["closed"] = closed(mechkit, case, f"{out}/extended.ini")
        (weak if truth.get("weak") else marks).append(mark)
        flags = " ".join(k for k in ("first", "rival", "both", "off", "alarm") if mark.get(k))
        print(f"{case.name} {truth['rig']:14} {truth['kind']:10} {', '.join(hidden):34} -> "
              f"{mark['verdict']:10} "
              f"{', '.join(n if j is None else f'{n}@{j}' for n, j in mark['said']):34} "
              f"{flags or '-':16} closed {mark.get('closed', math.nan):6.3f} "
              f"{mark['seconds']:5.1f} s{' weak' if truth.get('weak') else ''}", flush=True)
    if not marks + weak:
        return
    singles = [m for m in marks if "first" in m]
    print(f"right first {share(singles, 'first')}, or among rivals {share(singles, 'rival')}; "
          f"false alarms {share(marks, 'alarm')}; off the catalogue {share(marks, 'off')}")
    gains = sorted(m["closed"] for m in marks if "closed" in m)
    if gains:
        print(f"closed: median {statistics.median(gains):.3f}, "
              f"worst tenth {gains[(len(gains) - 1) // 10]:.3f}, least {gains[0]:.3f}")
    errors = [m["error"] for m in marks if m.get("error") is not None]
    if errors:
        print(f"main parameter: median error {100 * statistics.median(errors):.2f} %, "
              f"largest {100 * max(errors):.2f} %")
    seconds = [m["seconds"] for m in marks + weak]
    print(f"seconds: median {statistics.median(seconds):.1f}, largest {max(seconds):.1f}")


if __name__ == "__main__":
    main()

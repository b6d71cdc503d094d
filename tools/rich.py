#!/usr/bin/env python3
"""Scores `mechkit explain` on rigs with several effects at once, some of them outside the catalogue.

usage: rich.py MECHKIT [CASE...]

The folder is $MECHKIT_SHARED/challenge_rich, or ../shared/challenge_rich beside the source tree;
without one this says so and exits 0. The answers say what each effect is `worth`: what its absence adds to the
error of free runs on the log held back, in the encoder noise's rms. Counted are

first      the first cause is one that matters: worth at least half of the largest worth
found      of the catalogue's effects worth 3 or more, those that are named
right      of the causes named, those that are there
closed     as in challenge.py, beside what the generator's own refit with the catalogue's effects attains
"""
import json
import math
import statistics
import subprocess
import sys
import tempfile
import time

from cases import cases
from challenge import among, closed

SHOWS = 3.0  # worth from which an effect shows
TIMEOUT = 180.0  # s a case


def names_of(truth):
    """By hidden effect: the names that are right for it. Some that the generator holds to be off the
    catalogue are in it by another name."""
    same = {"normal-load-friction": "load-friction"}
    names = []
    for e in truth["effects"]:
        names.append([(e["name"], e["joint"])])
        if same.get(e["name"]):
            names[-1].append((same[e["name"]], e["joint"]))
    for other in truth.get("accept", []):
        names[other.get("effect", 0)].append((other["name"], other.get("joint")))
    return names


def attainable(score):
    """What the generator's refit with the catalogue's effects closes."""
    after, floor, refit = (sum((rms / std) ** 2 for rms, std in zip(score[key], score["std"]))
                           for key in ("attainable", "floor", "refit"))
    return max(-1.0, min(1.0, 1.0 - (after - floor) / (refit - floor)))


def judge(truth, report):
    said = [(c["name"], c["joint"]) for c in report["causes"]]
    right = names_of(truth)
    worth = [e["worth"] for e in truth["effects"]]
    most = max(worth)
    shows = [r for r, e in zip(right, truth["effects"]) if not e["off"] and e["worth"] >= SHOWS]
    return {
        "said": said,
        "first": bool(said) and any(among(said[0], r) and w >= 0.5 * most
                                    for r, w in zip(right, worth)),
        "show": len(shows),
        "found": sum(any(among(n, r) for n in said) for r in shows),
        "named": len(said),
        "right": sum(any(among(n, r) for r in right) for n in said),
        "verdict": report["verdict"], "as_said": report["verdict"] == truth["verdict"],
    }


def explained(mechkit, case, out):
    hold = ["--holdout", case.holdout]
    subprocess.run([mechkit, "explain", "--model", case.model, "--out", out] + hold + case.train,
                   capture_output=True, text=True, timeout=TIMEOUT)
    with open(f"{out}/report.json") as file:
        return json.load(file)


def hidden_text(truth):
    return ", ".join(f"{e['name']}{'@%d' % e['joint'] if e['joint'] else ''} {e['worth']:.0f}"
                     f"{' (off)' if e['off'] else ''}"
                     for e in sorted(truth["effects"], key=lambda e: -e["worth"]))


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    mechkit, marks = sys.argv[1], []
    for case in cases(sys.argv[2:], "challenge_rich"):
        with tempfile.TemporaryDirectory() as out:
            begin = time.time()
            try:
                report = explained(mechkit, case, out)
                gain = closed(mechkit, case, f"{out}/extended.ini")
            except (subprocess.TimeoutExpired, OSError, ValueError):
                report, gain = {"verdict": "FAILED", "causes": []}, -1.0
        mark = judge(case.truth, report)
        mark.update(seconds=time.time() - begin, closed=gain,
                    attainable=attainable(case.truth["score"]))
        marks.append(mark)
        said = ", ".join(n if j is None else f"{n}@{j}" for n, j in mark["said"])
        print(f"{case.name} {case.truth['rig']:14} {hidden_text(case.truth)}\n"
              f"    -> {mark['verdict']}{'' if mark['as_said'] else '!'}: {said or 'nothing'}; "
              f"{'first, ' if mark['first'] else ''}found {mark['found']} of {mark['show']}, "
              f"right {mark['right']} of {mark['named']}, closed {mark['closed']:.3f} "
              f"({mark['attainable']:.3f}), {mark['seconds']:.1f} s", flush=True)
    if not marks:
        return
    total = {key: sum(m[key] for m in marks) for key in ("first", "show", "found", "named", "right",
                                                         "as_said")}
    share = [m["closed"] / m["attainable"] for m in marks if m["attainable"] > 0.0]
    seconds = [m["seconds"] for m in marks]
    print(f"first cause matters {total['first']} of {len(marks)}; found {total['found']} of "
          f"{total['show']} that show; right {total['right']} of {total['named']} named; verdict "
          f"{total['as_said']} of {len(marks)}\n"
          f"closed: median {statistics.median(m['closed'] for m in marks):.3f}, over what is "
          f"attainable {statistics.median(share) if share else math.nan:.3f}, least "
          f"{min(m['closed'] for m in marks):.3f}\n"
          f"seconds: median {statistics.median(seconds):.1f}, largest {max(seconds):.1f}")


if __name__ == "__main__":
    main()

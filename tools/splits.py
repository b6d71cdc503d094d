#!/usr/bin/env python3
"""How much what mechkit says of measured rigs hangs on which logs it learns from.

usage: splits.py MECHKIT [FOLDER...]

The rigs of measured.py, each with other logs to learn from: the first halves of the usual ones, their
second halves, the roles of the logs exchanged, and three splits of all logs by chance. Printed are
the verdict, the share of the gap that is closed on the logs held back, and the causes, the largest
first. Without the folder of logs this says so and exits 0. No package beyond Python's own is needed.
"""
import os
import random
import sys
import tempfile

from measured import cause_text, explained, imported, parted, rigs

SPLITS = 3


def halves(logs, which, scratch):
    """The first (0) or second (1) half of each log."""
    some = []
    for number, log in enumerate(logs):
        folder = f"{scratch}/half{number}"
        os.makedirs(folder, exist_ok=True)
        some.append(parted(log, 0.5, folder)[which])
    return some


def variants(rig, train, held, scratch):
    yield "as usual", train, held
    yield "first halves", halves(train, 0, scratch), held
    yield "second halves", halves(train, 1, scratch), held
    yield "exchanged", held, train
    if not rig.cut:
        logs = train + held
        for split in range(SPLITS):
            some = random.Random(split).sample(logs, len(train))
            yield f"split {split + 1}", some, [log for log in logs if log not in some]


def said(report):
    largest = sorted((item for item in report["budget"]["items"] if item["cause"] is not None
                      and item["cause"] >= 0), key=lambda item: -item["share"])
    named = [cause_text(report["causes"][item["cause"]]) for item in largest]
    return (f"{report['verdict']:10s} closes {100 * report['budget']['closed']:3.0f} %  "
            + (", ".join(named) or "nothing named"))


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    mechkit, wanted = sys.argv[1], sys.argv[2:]
    for rig, source, models in rigs(wanted):
        print(f"\n{rig.name} ({rig.folder})")
        with tempfile.TemporaryDirectory() as scratch:
            train, held = imported(mechkit, rig, source, models, scratch)
            for name, learn, other in variants(rig, train, held, scratch):
                try:
                    report = explained(mechkit, rig, f"{models}/{rig.model}.ini", learn, other,
                                       scratch)[1]
                    print(f"  {name:14s} {said(report)}", flush=True)
                except RuntimeError as why:
                    print(f"  {name:14s} {why}", flush=True)


if __name__ == "__main__":
    main()

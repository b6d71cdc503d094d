#!/usr/bin/env python3
"""What mechkit makes of rigs that other people measured, on logs that no fit has seen.

usage: measured.py MECHKIT OUT.json [FOLDER...]

The logs are those of $MECHKIT_SHARED/data (or ../shared/data beside the source tree); without the
folder this says so and exits 0. They are taken in by the mapping that lies beside each rig's published
model (models/measured). Compared are four models: as given; refitted to the training logs; refitted with
what is about the data and not about the rig (zeros of every log's own, the better column of the
command); and as explain extends it. Printed is, for each log held back, how far free runs that are
restarted every so often end up from the readings, as rms error in thousandths of the joint's unit. OUT.json
has the same figures, all parameters, what explain says and how long it took. No package beyond
Python's own is needed.
"""
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import namedtuple

from cases import shared

# `zeros`: joints whose encoder is zeroed before each log where the joint hangs. `cut`: the last part of
# a rig's only log is held back.
Rig = namedtuple("Rig", "name folder model map zeros train held window cut", defaults=[None])

RIGS = [
    Rig("single pendulum", "single-pendulum-dfki", "pendulum-dfki", "pendulum-dfki", [1],
        ["ddp", "energy_shaping"], ["direct_collocation", "pd_stiff_tracking", "ilqr"], 0.5),
    Rig("double pendulum C.1", "pendubot-dfki-c1-sysid", "double-pendulum-dfki-c1",
        "double-pendulum-dfki", [1, 2], ["run_143339", "run_143601", "run_143704", "run_154220"],
        ["run_143906", "run_144115"], 0.5),
    Rig("C.1, swing-ups", "pendubot-dfki-c1-swingup", "double-pendulum-dfki-c1",
        "double-pendulum-dfki", [1, 2], ["tvlqr_02", "tvlqr_05"], ["tvlqr_08", "tvlqr_04"], 0.25),
    Rig("double pendulum A.0", "double-pendulum-dfki-a0", "double-pendulum-dfki-a0",
        "double-pendulum-dfki", [1, 2],
        ["sysid_00", "sysid_02", "sysid_04", "sysid_11", "sysid_13"],
        ["sysid_01", "sysid_12", "swingup_balance_174435"], 0.5),
    Rig("Furuta pendulum", "furuta-qube-servo1", "furuta-qube-servo1", "furuta-qube-servo1", [],
        ["ep_150615", "ep_161441", "ep_161843", "ep_162441", "ep_162807"],
        ["ep_163141", "ep_163558", "ep_163955"], 0.25),
    Rig("cart-pole", "cartpole-sensorsini", "cartpole-sensorsini", "cartpole-sensorsini", [],
        ["run1", "run2", "run3"], ["run4"], 0.25),
    Rig("DC motor", "dcmotor-gkeiel", "dcmotor-gkeiel", "dcmotor-gkeiel", [],
        ["run1_pid_sine", "run2_pid_step"], ["run3_pr_sine", "run4_repetitive_sine"], 1.0),
    Rig("linear axis", "emps", "emps", "emps", [], ["tracking"], [], 1.0, 0.75),
    Rig("free double pendulum", "multiarm-free", "multiarm-double", "multiarm-double", [],
        ["run1_double_0_60s"], [], 0.5, 0.75),
    Rig("free single pendulum", "multiarm-free", "multiarm-single", "multiarm-single", [],
        ["run3_single_55s"], [], 0.5, 0.75),
]


def rigs(wanted):
    """Each rig, the folder of its logs and that of its model; of these folders only, if any are given."""
    here = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    models = os.path.join(here, "models", "measured")
    for rig in RIGS:
        source = os.path.join(shared(), "data", rig.folder)
        if wanted and rig.folder not in wanted:
            continue
        if not os.path.isdir(source):
            print(f"SKIPPED: no logs in {source}")
        elif not os.path.exists(f"{models}/{rig.model}.ini"):
            print(f"SKIPPED: {rig.name}: there is no {models}/{rig.model}.ini")
        else:
            yield rig, source, models


def call(mechkit, *arguments):
    done = subprocess.run([mechkit, *arguments], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{arguments[0]}: {done.stderr.strip()[-400:]}")


def parted(log, share, scratch):
    """A log in two files, the first one with this share of its rows."""
    with open(log) as file:
        lines = file.readlines()
    head = next(i for i, line in enumerate(lines) if not line.startswith("#")) + 1
    middle = head + int(share * (len(lines) - head))
    parts = [f"{scratch}/first.csv", f"{scratch}/rest.csv"]
    for part, rows in zip(parts, (lines[head:middle], lines[middle:])):
        with open(part, "w") as file:
            file.writelines(lines[:head] + rows)
    return parts


def imported(mechkit, rig, source, models, scratch):
    """The logs as mechkit's own: those to learn from, those held back."""
    for log in rig.train + rig.held:
        call(mechkit, "import", f"{source}/{log}.csv", "--map", f"{models}/{rig.map}.map", "--out",
             f"{scratch}/{log}.csv")
    if rig.cut:
        first, rest = parted(f"{scratch}/{rig.train[0]}.csv", rig.cut, scratch)
        return [first], [rest]
    return ([f"{scratch}/{log}.csv" for log in rig.train],
            [f"{scratch}/{log}.csv" for log in rig.held])


def fitted(mechkit, model, train, out, *more):
    call(mechkit, "identify", "--model", model, "--out", out, "--json", out + ".json", *more, *train)
    with open(out + ".json") as file:
        return json.load(file)


def with_zeros(model, joints, out):
    """The model with encoders that are zeroed before each log."""
    with open(model) as file:
        text = file.read()
    for joint in joints:
        text += (f"\n[effect.encoder-offset.{joint}]\njoint = {joint}\noffset = 0\n"
                 "offset_spread = 0.03\n")
    with open(out, "w") as file:
        file.write(text)


def errors(mechkit, rig, model, log, start, scratch):
    """rms error by joint, and from which second on it was counted: own values take the first half."""
    figures = f"{scratch}/figures.json"
    more = ["--from", str(start)] if start else []
    call(mechkit, "simulate", "--model", model, "--input", log, "--window", str(rig.window), "--json",
         figures, *more)
    with open(figures) as file:
        found = json.load(file)
    return found["rms"], found.get("from_s") or 0.0


def explained(mechkit, rig, model, train, held, scratch):
    folder = f"{scratch}/report"
    hold = [word for log in held for word in ("--holdout", log)]
    begin = time.time()
    call(mechkit, "explain", "--model", model, "--window", str(rig.window), "--out", folder, *hold,
         *train)
    with open(f"{folder}/report.json") as file:
        report = json.load(file)
    return f"{folder}/extended.ini", report, time.time() - begin


def study(mechkit, rig, source, models, scratch):
    given = f"{models}/{rig.model}.ini"
    train, held = imported(mechkit, rig, source, models, scratch)
    refit = fitted(mechkit, given, train, f"{scratch}/refit.ini", "--input", "measured")
    with_zeros(given, rig.zeros, f"{scratch}/zeros.ini")
    data = fitted(mechkit, f"{scratch}/zeros.ini", train, f"{scratch}/data.ini")
    extended, report, seconds = explained(mechkit, rig, given, train, held, scratch)
    compared = {"given": given, "refitted": f"{scratch}/refit.ini", "data": f"{scratch}/data.ini",
                "extended": extended}
    logs = {}
    for log in held:
        start = errors(mechkit, rig, compared["data"], log, 0.0, scratch)[1]
        start = max(start, errors(mechkit, rig, extended, log, 0.0, scratch)[1])
        one = {}
        for name, model in compared.items():
            rms, own = errors(mechkit, rig, model, log, 0.0, scratch)
            one[name] = rms if own or not start else errors(mechkit, rig, model, log, start,
                                                            scratch)[0]
        logs[os.path.basename(log)] = one
    return {"window_s": rig.window, "held_back": logs, "refit": refit["parameters"],
            "data": data["parameters"], "input": data["input"], "seconds": seconds,
            "explain": {key: report[key] for key in ("verdict", "causes", "structure", "budget",
                                                     "left_out", "holdout")}}


def cause_text(cause):
    joint = f" at joint {cause['joint']}" if cause["joint"] else ""
    return cause["name"] + joint + (" (each log its own)" if cause.get("per_log") else "")


def show(rig, result):
    print(f"\n{rig.name} ({rig.folder}), free runs of {rig.window} s, rms error in thousandths")
    print(f"  {'held back':28s}" + "".join(f"{name:>18s}" for name in
                                            ("given", "refitted", "data's own", "extended")))
    for log, models in result["held_back"].items():
        print(f"  {log:28s}" + "".join(
            f"{' '.join(f'{1e3 * x:.3g}' if x is not None else '-' for x in rms):>18s}"
            for rms in models.values()))
    e = result["explain"]
    budget = e["budget"]
    named = [cause_text(c) for c in e["causes"]]
    if any(item.get("input") for item in budget["items"]):
        named.append("the other column of the command")
    print(f"  explain: {e['verdict']}, closes {100 * budget['closed']:.0f} %, "
          f"{result['seconds']:.0f} s: "
          + (", ".join(named) or "nothing named")
          + (f"; {e['structure']}" if e["structure"] else ""), flush=True)


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    mechkit, out, wanted = sys.argv[1], sys.argv[2], sys.argv[3:]
    results, failed = {}, False
    for rig, source, models in rigs(wanted):
        with tempfile.TemporaryDirectory() as scratch:
            try:
                results[rig.name] = study(mechkit, rig, source, models, scratch)
                show(rig, results[rig.name])
            except RuntimeError as why:
                failed = True
                print(f"\n{rig.name}: {why}", flush=True)
        with open(out, "w") as file:
            json.dump(results, file, indent=1)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()

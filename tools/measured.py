#!/usr/bin/env python3
"""Fits rigs that other people measured, beside their published parameters.

usage: measured.py MECHKIT [FOLDER...]

The logs are those of $MECHKIT_SHARED/data (or ../shared/data beside the source tree); without the
folder this says so and exits 0. They are taken in by the mapping that lies beside each rig's published
model (models/measured); that model is fitted to the training logs as it is, and again with the effects
below. Printed is how far free runs, restarted from the readings every so often, end up from the
readings: rms error over the standard deviation. Then explain says what it finds in the published
model. No package beyond Python's own is needed.
"""
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from collections import namedtuple

from cases import shared

Rig = namedtuple("Rig", "folder model map without effects train validate window")

# Effects to add: section, joint or None, start values.
ZEROS = [("effect.encoder-offset", 1, {"offset": -0.01}),  # set by hand
         ("effect.encoder-offset.2", 2, {"offset": 0.01})]
# Gears stick where Coulomb friction of a finite slope creeps: it is left out for this.
STICKS = [("effect.stiction", 2, {"stiffness": 20.0, "damping": 0.05, "level": 0.15})]
CREEPS = ["effect.coulomb", "effect.viscous"]
QUBE = [("effect.cable-stiffness", 1, {"stiffness": 0.1, "rest": 0.0}),  # the encoder's wire
        ("effect.deadband", None, {"width": 0.1})]

# The splits are those that came with the data. Windows are short where the rig is unstable.
RIGS = [
    Rig("single-pendulum-dfki", "pendulum-dfki", "pendulum-dfki", [], [],
        ["ddp", "energy_shaping"], ["direct_collocation", "pd_stiff_tracking", "ilqr"], 0.5),
    Rig("pendubot-dfki-c1-sysid", "double-pendulum-dfki-c1", "double-pendulum-dfki", CREEPS, STICKS,
        ["run_143339", "run_143601", "run_143704", "run_154220"], ["run_143906", "run_144115"],
        0.5),
    Rig("pendubot-dfki-c1-swingup", "double-pendulum-dfki-c1", "double-pendulum-dfki", [], ZEROS,
        ["tvlqr_02", "tvlqr_05"], ["tvlqr_08", "tvlqr_04"], 0.25),
    Rig("double-pendulum-dfki-a0", "double-pendulum-dfki-a0", "double-pendulum-dfki", [], ZEROS,
        ["sysid_00", "sysid_02", "sysid_04", "sysid_11", "sysid_13"],
        ["sysid_01", "sysid_12", "swingup_balance_174435"], 0.5),
    Rig("furuta-qube-servo1", "furuta-qube-servo1", "furuta-qube-servo1", [], QUBE,
        ["ep_150615", "ep_161441", "ep_161843", "ep_162441", "ep_162807"],
        ["ep_163141", "ep_163558", "ep_163955"], 0.25),
]


def call(mechkit, *arguments):
    done = subprocess.run([mechkit, *arguments], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr.strip())


def with_effects(fitted, without, effects, out):
    """The fitted model with some effects less and some more."""
    with open(fitted) as file:
        sections = re.split(r"(?m)^(?=\[)", file.read())
    with open(out, "w") as file:
        file.writelines(s for s in sections if not s.startswith(tuple(f"[{w}]" for w in without)))
        for section, joint, values in effects:
            file.write(f"\n[{section}]\n" + (f"joint = {joint}\n" if joint else ""))
            file.writelines(f"{key} = {value}\n" for key, value in values.items())


def imported(mechkit, rig, folder, models_folder, scratch):
    """The rig's logs as mechkit's own; returns their folder."""
    for log in rig.train + rig.validate:
        call(mechkit, "import", f"{folder}/{log}.csv", "--map", f"{models_folder}/{rig.map}.map",
             "--out", f"{scratch}/{log}.csv")
    return scratch


def fit(mechkit, rig, folder, model, scratch, name):
    """Fits the training logs; returns the fitted model's file and the fit's JSON."""
    out, figures = f"{scratch}/{name}.ini", f"{scratch}/{name}.json"
    call(mechkit, "identify", "--model", model, "--out", out, "--json", figures,
         *(f"{folder}/{log}.csv" for log in rig.train))
    with open(figures) as file:
        return out, json.load(file)


def errors(mechkit, rig, folder, model, scratch, log):
    """nrmse of each joint over the log."""
    figures = f"{scratch}/errors.json"
    call(mechkit, "simulate", "--model", model, "--input", f"{folder}/{log}.csv", "--window",
         str(rig.window), "--out", f"{scratch}/predicted.csv", "--json", figures)
    with open(figures) as file:
        return [math.nan if x is None else x for x in json.load(file)["nrmse"]]


def show(rig, models, rows):
    print(f"\n{rig.folder}, free runs of {rig.window} s, nrmse of each joint")
    print(f"  {'':34s}" + "".join(f"{name:>20s}" for name in models))
    for log, cells in rows:
        sort = "" if log in rig.train else " (held back)"
        print(f"  {log + sort:34s}" + "".join(f"{c:>20s}" for c in cells), flush=True)


def study(mechkit, rig, folder, models_folder, scratch):
    published = f"{models_folder}/{rig.model}.ini"
    folder = imported(mechkit, rig, folder, models_folder, scratch)
    fitted, figures = fit(mechkit, rig, folder, published, scratch, "fitted")
    models = {"published": published, "fitted": fitted}
    if rig.effects:
        with_effects(fitted, rig.without, rig.effects, f"{scratch}/start.ini")
        models["with effects"], figures = fit(mechkit, rig, folder, f"{scratch}/start.ini",
                                              scratch, "more")
    rows = [(log, [" ".join(f"{x:.3f}" for x in errors(mechkit, rig, folder, m, scratch, log))
                   for m in models.values()]) for log in rig.train + rig.validate]
    show(rig, models, rows)
    print("  " + ", ".join(f"{k.replace('effect.', '')} {p['value']:.4g} +- {p['stderr'] or 0:.1g}"
                           for k, p in figures["parameters"].items()))
    for warning in figures["warnings"]:
        print("  warning:", warning)


def explain(mechkit, rig, folder, models_folder, scratch):
    """What the published model lacks, and what held-back logs say to it."""
    logs = [f"{folder}/{log}.csv" for log in rig.train]
    held = [word for log in rig.validate for word in ("--holdout", f"{folder}/{log}.csv")]
    call(mechkit, "explain", "--model", f"{models_folder}/{rig.model}.ini", "--window",
         str(rig.window), "--out", f"{scratch}/explained", *held, *logs)
    with open(f"{scratch}/explained/report.json") as file:
        report = json.load(file)
    held_out = report["holdout"]
    print(f"  explain: {report['verdict']}: "
          + (report["structure"] or ", ".join(c["name"] for c in report["causes"])))
    for name in ("nrmse_before", "nrmse_refit", "nrmse_after", "noise_floor"):
        cells = " ".join("-" if x is None else f"{x:.3f}" for x in held_out[name])
        print(f"    {name:14s}{cells}")
    print(f"    closed {held_out['closed']:.2f}, {report['seconds']:.0f} s", flush=True)


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    mechkit, wanted = sys.argv[1], sys.argv[2:]
    here = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    for rig in RIGS:
        folder = os.path.join(shared(), "data", rig.folder)
        if wanted and rig.folder not in wanted:
            continue
        if not os.path.isdir(folder):
            print(f"SKIPPED: no logs in {folder}")
            continue
        with tempfile.TemporaryDirectory() as scratch:
            try:
                models = os.path.join(here, "models", "measured")
                study(mechkit, rig, folder, models, scratch)
                explain(mechkit, rig, scratch, models, scratch)
            except RuntimeError as why:
                sys.exit(f"measured: {rig.folder}: {why}")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Scores `mechkit investigate` on rigs that another simulator hides behind docs/protocol.md.

usage: hidden_rigs.py MECHKIT HIDDEN_RIG [--rigs N] [--seed S] [--jobs N] [--out DIR] [--json FILE]
                      [--only NUMBER,NUMBER ...] [--experiments N] [--no-fixed]

HIDDEN_RIG is build/release/mechkit-hidden-rig: equations of its own, the true parameters 3 to 20 % off
the model that is given. Beside each investigation the same budget is spent on fixed experiments (sines,
chirps, random inputs) that `mechkit explain` is given. Both models are then judged by the same two fresh
runs. Rig NUMBER of a seed is always the same. No package beyond Python's own is needed.
"""
import argparse
import concurrent.futures
import json
import math
import os
import random
import shutil
import signal
import statistics
import subprocess
import threading
import time

from wire import Host

PLANTS = ["inertia-wheel", "pendubot", "reaction-wheel", "furuta", "pendulum"]
KINDS = ["single", "pair", "parameters", "single", "pair", "none", "single", "pair"]
OFF = {(1, 6), (3, 6)}  # (plant, round): outside the catalogue
RESTS = {"pendubot": (-math.pi / 2, 0.0), "furuta": (0.0, math.pi)}
RATE = 500
SECONDS = 10.0
TIMEOUT = 3600.0  # s a program
KEPT = 3.3        # rad: where a fixed experiment ends, and is repeated with 60 % of its command


def invisible(plant, effect):
    """What a rig that is zeroed where it hangs cannot show: where its encoders or its base stand."""
    return effect["name"] == "encoder-offset" or (effect["name"] == "base-tilt" and plant != "furuta")


class Rig:
    """A served rig, and what is true of it."""

    def __init__(self, program, folder, plant, kind, seed):
        self.folder, self.plant, self.kind = folder, plant, kind
        os.makedirs(folder)
        self.given = f"{folder}/given.ini"
        while True:
            self.server = subprocess.Popen(
                [program, "--seed", str(seed), "--rig", plant, "--kind", kind, "--given", self.given,
                 "--truth", f"{folder}/truth.json"], stdout=subprocess.PIPE, text=True)
            line = self.server.stdout.readline()
            with open(f"{folder}/truth.json") as file:
                self.truth = json.load(file)
            if not any(invisible(plant, e) for e in self.truth["effects"]):
                break
            self.close()
            seed += 100000
        self.seed = seed
        self.device = line.split()[-1]
        two = plant in ("pendubot", "reaction-wheel", "furuta")
        self.joints = 2 if two else 1
        self.count = [2 * math.pi / cpr for cpr in self.truth["cpr"]]
        # Rounding and a uniform jitter before it.
        self.places = []  # of every zero, counts; those of fresh runs are all where the rig begins
        threading.Thread(target=self.listen, daemon=True).start()
        self.noise = [c * math.sqrt(1 / 12 + self.truth["jitter"] ** 2 / 3) for c in self.count]

    def listen(self):
        for line in self.server.stdout:
            if line.startswith("zero:"):
                self.places.append([int(word) for word in line.split()[1:]])

    def close(self):
        self.server.send_signal(signal.SIGTERM)
        self.server.wait()


def run_input(rig, signal_of, path):
    """Runs an input from rest and writes its log. False: a link went too far."""
    host = Host(rig.device)
    host.ask(2)  # zero
    rest = RESTS.get(rig.plant, (0.0, 0.0))
    period = 1000000000 // RATE
    rows, fine = [], True
    for k in range(int(SECONDS * RATE)):
        u = max(-10.0, min(10.0, round(signal_of(k / RATE), 6)))
        counts = host.exchange(u, period)
        q = [rest[j] + counts[j] * rig.count[j] for j in range(rig.joints)]
        rows.append(",".join([f"{k / RATE:.9g}"] + [f"{x:.12g}" for x in q] + [f"{u:.9g}"]))
        for j in range(rig.joints):
            wheel = rig.plant == "inertia-wheel" or (rig.plant == "reaction-wheel" and j == 1)
            if not wheel and abs(q[j] - rest[j]) > KEPT:
                fine = False
        if not fine:
            break
    host.close()
    cpr = " ".join(f"{c:g}" for c in rig.truth["cpr"][:rig.joints])
    with open(path, "w") as file:
        file.write(f"# mechkit-log: 1\n# rig: {rig.plant}\n# sample_rate_hz: {RATE}\n# encoder_cpr: {cpr}\n"
                   + ("t,q1,q2,u\n" if rig.joints == 2 else "t,q1,u\n") + "\n".join(rows) + "\n")
    return fine


def multisine(seed, low, high):
    draw = random.Random(seed)
    lines = [(draw.uniform(0.3, 1.0), 2 * math.pi * draw.uniform(low, high), draw.uniform(0, 2 * math.pi))
             for _ in range(8)]
    scale = 2.0 / sum(a for a, _, _ in lines)
    return lambda t: scale * sum(a * math.sin(w * t + p) for a, w, p in lines)


def chirp(low, high):
    rise = (high - low) / SECONDS
    return lambda t: math.sin(2 * math.pi * (low + 0.5 * rise * t) * t)


def steps(seed):
    draw = random.Random(seed)
    levels = [draw.uniform(-1, 1) for _ in range(100)]
    return lambda t: levels[int(t / 0.7)]


# What somebody runs who does not look at what came before: amplitude as a share of u_max, and form.
FIXED = [(0.3, lambda t: math.sin(3 * t)), (0.3, chirp(0.3, 4)), (0.3, multisine(1, 0.2, 5)),
         (0.15, lambda t: math.sin(6 * t)), (0.15, chirp(0.1, 1.5)), (0.5, multisine(2, 0.2, 5)),
         (0.5, lambda t: math.sin(0.8 * t)), (0.5, multisine(3, 0.1, 3))]
VALIDATION = [(0.35, multisine(71, 0.1, 4)), (0.35, steps(72))]


def run_family(rig, family, name):
    paths = []
    for number, (share, form) in enumerate(family):
        path, amplitude = f"{rig.folder}/{name}-{number + 1}.csv", 10.0 * share
        while not run_input(rig, lambda t: amplitude * form(t), path):
            amplitude *= 0.6
        paths.append(path)
    return paths


def seen_from(rig, place, logs):
    """Logs counted from a place, as an investigation counts from the zero of its first run: joints that
    rest anywhere are elsewhere then, and on a base that leans that moves where the others hang."""
    paths = []
    for log in logs:
        paths.append(log.replace(".csv", "-there.csv"))
        with open(log) as file, open(paths[-1], "w") as out:
            for line in file:
                fields = line.split(",")
                if line[0].isdigit():
                    for j in range(rig.joints):
                        moved = (rig.places[0][j] - place[j]) * rig.count[j]
                        fields[1 + j] = f"{float(fields[1 + j]) + moved:.12g}"
                out.write(",".join(fields))
    return paths


def predicted(mechkit, rig, model, logs):
    """The worst rms of free runs of 1 s over the logs and joints, over the noise of a reading."""
    worst = 0.0
    for log in logs:
        done = subprocess.run([mechkit, "simulate", "--model", model, "--input", log, "--window", "1",
                               "--json", "-"], capture_output=True, text=True)
        if done.returncode:
            return math.inf
        report = json.loads(done.stdout)
        rms = report["rms"]
        worst = max([worst, math.inf if report["failed"] else 0.0]
                    + [r / rig.noise[j] for j, r in enumerate(rms)])
    return worst


def base_error(rig, model):
    """The largest and the median relative error of base parameters."""
    values, inside = {}, False
    with open(model) as file:
        for line in file:
            if line.startswith("["):
                inside = line.strip() == "[parameters]"
            elif inside and "=" in line:
                key, value = line.split("=")
                values[key.strip()] = float(value)
    return {k: abs(values[k] / v - 1) for k, v in rig.truth["parameters"].items() if k in values}


def named(text):
    """'stribeck at joint 2: level ..' as (name, joint)."""
    name = text.split(":")[0]
    head, _, joint = name.partition(" at joint ")
    return head, int(joint.split(",")[0]) if joint else 0


def judge(rig, causes, claims, tied):
    """What causes named in that order are worth."""
    right = [[tuple(name) for name in e["right"]] for e in rig.truth["effects"]]

    def among(cause, names):
        return any(cause[0] == n and (joint == 0 or cause[1] == joint) for n, joint in names)

    mark = {"said": [f"{n}@{j}" if j else n for n, j in causes], "claims": claims}
    if rig.kind in ("none", "parameters"):
        mark["alarm"] = claims
    elif rig.kind != "off":
        mark["first"] = claims and bool(causes) and any(among(causes[0], r) for r in right)
        mark["rival"] = mark["first"] or any(among(c, r) for c in causes + tied for r in right)
        mark["all"] = claims and all(any(among(c, r) for c in causes) for r in right)
        mark["more"] = claims and sum(not any(among(c, r) for r in right) for c in causes)
    return mark


def tied_in(text):
    """Rivals of a finding's `open`."""
    return [named(part.split(" instead of ")[0]) for part in text.split("; ") if part]


def investigated(mechkit, rig, experiments, logs):
    begin, zeros = time.time(), len(rig.places)
    out = f"{rig.folder}/investigation"
    done = subprocess.run(
        [mechkit, "investigate", "--model", rig.given, "--board", "tcp", "--device", rig.device, "--fast",
         "--out", out, "--experiments", str(experiments), "--minutes", "600", "--threads", "1"],
        capture_output=True, text=True, timeout=TIMEOUT)
    with open(f"{rig.folder}/investigation.txt", "w") as file:
        file.write(done.stdout + done.stderr)
    mark = {"seconds": time.time() - begin, "failed": ""}
    try:
        with open(f"{out}/journal.json") as file:
            journal = json.load(file)
    except OSError:
        journal = {"experiments": [], "stopped": ""}
    found = [x["finding"] for x in journal["experiments"] if x.get("finding", {}).get("verdict")]
    if not found:
        return {**mark, **judge(rig, [], False, []), "failed": done.stderr.strip() or "nothing was learned"}
    last = found[-1]
    logs = seen_from(rig, rig.places[zeros], logs)
    causes = [named(c["cause"]) for c in last["causes"]]
    mark.update(judge(rig, causes, last["verdict"] == "effect", tied_in(last["open"])))
    if not journal["stopped"]:
        mark["failed"] = done.stderr.strip()
    return {**mark, "verdict": last["verdict"], "stopped": journal["stopped"],
            "experiments": len(journal["experiments"]), "rest": last["rest"],
            "rig_s": journal["look_s"] + sum(x["rig_s"] for x in journal["experiments"]),
            "error": predicted(mechkit, rig, f"{out}/model.ini", logs),
            "refit": max(r / n for r, n in zip(last["refit"], rig.noise)),
            "base": base_error(rig, f"{out}/model.ini")}


def explained(mechkit, rig, fixed, name, logs):
    out = f"{rig.folder}/{name}"
    begin = time.time()
    try:
        subprocess.run([mechkit, "explain", "--model", rig.given, "--out", out, "--threads", "1"] + fixed,
                       capture_output=True, text=True, timeout=TIMEOUT)
        with open(f"{out}/report.json") as file:
            report = json.load(file)
    except (subprocess.TimeoutExpired, OSError, ValueError):
        return {**judge(rig, [], False, []), "failed": "no report", "seconds": time.time() - begin}
    causes = [(c["name"], c["joint"] or 0) for c in report["causes"]]
    tied = [(r["name"], r["joint"] or 0) for r in report["rivals"] if not r["distinguishable"]]
    mark = judge(rig, causes, report["verdict"] == "effect", tied)
    return {**mark, "failed": "", "verdict": report["verdict"], "seconds": time.time() - begin,
            "experiments": len(fixed), "error": predicted(mechkit, rig, f"{out}/extended.ini", logs),
            "base": base_error(rig, f"{out}/extended.ini")}


def one_rig(o, number):
    plant, round_ = number % len(PLANTS), number // len(PLANTS) % len(KINDS)
    kind = "off" if (plant, round_) in OFF else KINDS[round_]
    folder = f"{o.out}/rig-{number + 1:03}"
    shutil.rmtree(folder, ignore_errors=True)
    rig = Rig(o.hidden_rig, folder, PLANTS[plant], kind, o.seed * 1000 + number)
    mark = {"number": number + 1, "plant": PLANTS[plant], "kind": kind,
            "hidden": [f"{e['name']}@{e['joint']}" if e["joint"] else e["name"]
                       for e in rig.truth["effects"]]}
    try:
        logs = run_family(rig, VALIDATION, "validation")
        mark["investigate"] = investigated(o.mechkit, rig, o.experiments, logs)
        # Judged by the rig, too: what a refit alone leaves there.
        if not o.no_fixed:
            fixed = run_family(rig, FIXED[:o.experiments], "fixed")
            few = max(1, mark["investigate"].get("experiments", o.experiments))
            mark["fixed"] = explained(o.mechkit, rig, fixed, "fixed-all", logs)
            mark["few"] = explained(o.mechkit, rig, fixed[:few], "fixed-few", logs) if few < len(fixed) \
                else mark["fixed"]
    finally:
        rig.close()
    # What cannot be seen cannot be named.
    mark["weak"] = kind not in ("none", "parameters") and mark["investigate"].get("refit", 99) < 2.0
    with open(f"{folder}/mark.json", "w") as file:
        json.dump(mark, file, indent=1)
    return mark


def line_of(mark):
    def brief(m):
        flags = " ".join(k for k in ("first", "rival", "all", "alarm") if m.get(k)) or "-"
        base = max(m.get("base", {0: math.nan}).values())
        return (f"{m.get('verdict', 'FAILED'):8} {'+'.join(m['said']) or '-':34} {flags:15} "
                f"n {m.get('experiments', 0)} err {m.get('error', math.nan):6.2f} base {100 * base:5.2f} % "
                f"{m['seconds']:5.0f} s{' ' + m['failed'] if m['failed'] else ''}")
    text = (f"{mark['number']:3} {mark['plant']:14} {mark['kind']:10} {'+'.join(mark['hidden']):30}"
            f"{' weak' if mark['weak'] else ''}\n      investigate {brief(mark['investigate'])}")
    for key in ("few", "fixed"):
        if key in mark:
            text += f"\n      {key:11} {brief(mark[key])}"
    return text


def summary(marks, key):
    """The figures of one way of experimenting."""
    seen = [(m, m[key]) for m in marks if key in m]
    matter = [(m, x) for m, x in seen if not m["weak"]]

    def count(pairs, flag):
        values = [bool(x.get(flag)) for _, x in pairs]
        return [sum(values), len(values)]

    single = [p for p in matter if p[0]["kind"] == "single"]
    pair = [p for p in matter if p[0]["kind"] == "pair"]
    clean = [p for p in seen if p[0]["kind"] in ("none", "parameters")]
    inside = [p for p in seen if p[0]["kind"] != "off"]
    errors = [x.get("error", math.inf) for _, x in inside]
    base = [v for _, x in inside for v in x.get("base", {}).values()]
    worst = [max(x["base"].values()) for _, x in inside if x.get("base")]
    return {
        "single_first": count(single, "first"), "pair_first": count(pair, "first"),
        "pair_both": count(pair, "all"), "alarms": count(clean, "alarm"),
        "wrong_besides": count([p for p in single + pair if p[1].get("more")], "more")[0],
        "predicted_within_twice_noise": [sum(e <= 2.0 for e in errors), len(errors)],
        "error_median": statistics.median(errors) if errors else None,
        "base_within_1_percent": [sum(b <= 0.01 for b in base), len(base)],
        "rigs_base_within_1_percent": [sum(b <= 0.01 for b in worst), len(inside)],
        "base_median": statistics.median(base) if base else None,
        "experiments_median": statistics.median(x.get("experiments", 0) for _, x in seen),
        "seconds_median": statistics.median(x["seconds"] for _, x in seen),
        "seconds_largest": max(x["seconds"] for _, x in seen),
        "failed": sum(bool(x["failed"]) for _, x in seen),
    }


def tell(figures):
    for key, f in figures.items():
        of = {k: f"{v[0]} of {v[1]}" for k, v in f.items() if isinstance(v, list)}
        print(f"\n{key}:\n  first right: {of['single_first']} singles, {of['pair_first']} pairs, both of "
              f"{of['pair_both']}; named wrongly besides {f['wrong_besides']}; clean rigs with a claim "
              f"{of['alarms']}\n  fresh runs predicted within twice the noise: "
              f"{of['predicted_within_twice_noise']}, median error {f['error_median']:.2f} times the noise\n"
              f"  base parameters within 1 %: {of['base_within_1_percent']} (all of a rig's: "
              f"{of['rigs_base_within_1_percent']}), median error {100 * f['base_median']:.3f} %\n"
              f"  experiments: median {f['experiments_median']:g}; seconds: median {f['seconds_median']:.0f}, "
              f"largest {f['seconds_largest']:.0f}; failed {f['failed']}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mechkit")
    parser.add_argument("hidden_rig")
    parser.add_argument("--rigs", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--out", default="build/hidden-rigs")
    parser.add_argument("--json")
    parser.add_argument("--only", default="")
    parser.add_argument("--experiments", type=int, default=8)
    parser.add_argument("--no-fixed", action="store_true")
    o = parser.parse_args()
    numbers = [int(n) - 1 for n in o.only.split(",") if n] or range(o.rigs)
    marks = []
    with concurrent.futures.ThreadPoolExecutor(o.jobs) as pool:
        for done in concurrent.futures.as_completed([pool.submit(one_rig, o, n) for n in numbers]):
            marks.append(done.result())
            print(line_of(marks[-1]), flush=True)
    figures = {key: summary(marks, key) for key in ("investigate", "few", "fixed")
               if any(key in m for m in marks)}
    tell(figures)
    weak = sum(m["weak"] for m in marks)
    print(f"\n{weak} effects too weak to be seen are left out of what is counted as right"
          if weak else "")
    if o.json:
        with open(o.json, "w") as file:
            json.dump({"seed": o.seed, "figures": figures, "rigs": sorted(marks, key=lambda m: m["number"])},
                      file, indent=1)


if __name__ == "__main__":
    main()

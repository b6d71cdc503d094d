#!/usr/bin/env python3
"""Mutation testing: changes one thing in the code at a time and asks whether a test notices.

    tools/mutate.py [--sample N] [--seed S] [--list] [--jobs N] FILE...

Works in a copy of the tree under build/mutants, with the objects of build/release so far as they are
newer than the sources; a mutant costs the compilation
of one file, a link, and the suites that look at that file (SUITES below), until the first that fails.
A mutant that does not compile counts for nothing. One that no suite notices is printed and counted
as a survivor. Some changes change nothing that can be seen: tools/mutants-equivalent.txt has those that were
looked at, each with its reason, and they are left out; so are calls that give memory back.

Exit code 0 when at least --least of the mutants (default 0.9) were noticed.
"""
import argparse
import os
import random
import re
import shutil
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
TREE = os.path.join(ROOT, "build", "mutants")

# Suites that are to notice a change, the quickest first. They call the code themselves: a suite that
# starts `mechkit` would start the one of build/release.
LOOP = "loop_faults loop_lies loop_start loop loop_log loop_params loop_samples loop_thread"
SUITES = [
    (r"src/ctrl/(safety|residual|board_watch)\.c", "safety loop_faults loop_lies loop_start residual"),
    (r"src/ctrl/loop_thread\.c", LOOP),
    (r"src/ctrl/loop.*\.c", LOOP + " bus_runs log_writer"),
    (r"src/base/(out_file|temporary|log_write|log_writer)\.c", "log_writer log"),
    (r"src/driver/usb.*\.c", "usb bus_faults bus_runs"),
    (r"src/driver/(board_)?parport\.c", "parport bus_faults"),
    (r"src/driver/standalone.*\.c", "standalone device device_stream"),
    (r"src/driver/(fault_script|board_virtual)\.c", "fault_script board loop_faults loop_lies loop_start"),
    (r"src/driver/emulated\.c", "fault_script board loop_faults loop_lies loop_start usb streams stream_troubles"),
    (r"src/driver/(byte_stream|tcp|resolve|serial|board_stream)\.c", "streams tcp serial stream_troubles bus_faults"),
    (r"src/driver/step_clock\.c", "clock frame device device_stream board standalone bus_faults"),
    (r"src/driver/device\.c", "device device_stream standalone frame bus_faults"),
    (r"src/driver/serve\.c", "serve streams tcp serial stream_troubles bus_faults"),
    (r"src/driver/wire\.c", "wire frame device device_stream usb board bus_runs standalone streams stream_troubles bus_faults"),
    (r"src/driver/", "frame device device_stream board usb bus_faults"),
]

SWAPS = [
    (r" <= ", " < "), (r" >= ", " > "), (r" < ", " <= "), (r" > ", " >= "), (r" == ", " != "),
    (r" != ", " == "), (r" && ", " || "), (r" \|\| ", " && "), (r" \+ ", " - "), (r" - ", " + "),
    (r"\+\+", "--"), (r"\btrue\b", "false"), (r"\bfalse\b", "true"), (r"\breturn MK_ERR_\w+;", "return MK_OK;"),
    (r"\bif \((?!!)(\w[^&|()]*)\)$", r"if (!(\1))"),
]
# A call or an assignment on a line of its own can be left out.
# Those that give memory back: a leak shows in `make check-asan` alone.
FREES = re.compile(r"^\s+(\(void\))?(free|\w+_free|\w+_destroy|cJSON_Delete|freeaddrinfo|libusb_free_\w+)\(.*;$")
STATEMENT = re.compile(r"^\s+(\(void\))?[A-Za-z_][\w>.\-\[\]]*( = | \+= | -= |\().*;$")
# A descriptor is 0 only where standard input was closed before.
DESCRIPTOR = re.compile(r"\b((\w*_)?fd|client|listening|terminal)$")
DECLARATION = re.compile(r"^\s+(static |const |struct |enum |unsigned |return|goto|"
                         r"(bool|int|double|float|char|size_t|u?int\d+_t|uint8_t|libusb_\w+|ssize_t|long|pid_t|DIR) )")


def mutants_of(path):
    """All changes of a file: (line number, what it says, what it is to say)."""
    found, comment = [], False
    with open(os.path.join(ROOT, path), encoding="utf-8") as f:
        lines = f.read().split("\n")
    for number, line in enumerate(lines, 1):
        code = line.strip()
        inside = comment or code.startswith(("/*", "//", "*"))
        comment = (comment or "/*" in line) and "*/" not in line.split("/*")[-1]
        if inside or not code or code.startswith("#") or "static const" in line:
            continue
        code_part = re.sub(r'"(\\.|[^"\\])*"', lambda m: "\0" * len(m.group(0)), line)
        code_part = code_part.split("/*")[0].rstrip()
        for pattern, text in SWAPS:
            for m in re.finditer(pattern, code_part):
                if pattern in (" < ", " >= ") and DESCRIPTOR.search(line[:m.start()]) and line[m.end():].startswith("0"):
                    continue
                changed = line[:m.start()] + m.expand(text) + line[m.end():]
                found.append((number, line, changed))
        if STATEMENT.match(code_part) and not DECLARATION.match(code_part) and not FREES.match(code_part):
            found.append((number, line, re.match(r"\s*", line).group(0) + ";"))
    return found


def equivalent():
    """Changes that change nothing a test could see: "file: line as it stands -> as it is changed"."""
    with open(os.path.join(ROOT, "tools", "mutants-equivalent.txt"), encoding="utf-8") as f:
        return {line.strip() for line in f if line.strip() and not line.startswith("#")}


def suites_of(path):
    for pattern, names in SUITES:
        if re.match(pattern, path):
            return names.split()
    sys.exit(f"mutate: no suites are known for {path}: add a line to SUITES")


def end_all():
    """Ends what still runs in the tree: a test that hangs is in a process group of its own."""
    for number in filter(str.isdigit, os.listdir("/proc")):
        try:
            if os.readlink(f"/proc/{number}/cwd").startswith(TREE):
                os.kill(int(number), 9)
        except OSError:
            continue  # gone, or somebody else's


def run(command, seconds, **environment):
    """Exit code; a command that takes too long has failed."""
    with subprocess.Popen(command, cwd=TREE, env=dict(os.environ, **environment), start_new_session=True,
                          stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            return process.wait(seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            end_all()
            return 124


def build(jobs):
    return run(["make", f"-j{jobs}", "all", "tests", *CACHE], 3600, CCACHE_BASEDIR=TREE, CCACHE_NOHASHDIR="1")


CACHE = ["CC=ccache cc", "CXX=ccache c++"] if shutil.which("ccache") else []


def first_to_fail(suites):
    for suite in suites:
        if run(["tools/run-tests.sh", "build/release/mechkit-tests", "release"], 240, CK_RUN_SUITE=suite,
               CK_DEFAULT_TIMEOUT="20"):
            return suite
    return None


def prepare(jobs, files):
    os.makedirs(os.path.join(TREE, "build"), exist_ok=True)
    subprocess.run(f"git ls-files -z --cached --others --exclude-standard | tar -c --null -T - | tar -x -C '{TREE}'",
                   shell=True, cwd=ROOT, check=True)
    objects = os.path.join(ROOT, "build", "release")
    if os.path.isdir(objects):
        subprocess.run(["cp", "-a", objects, os.path.join(TREE, "build") + "/"], check=True)
    if build(jobs):
        sys.exit("mutate: the tree does not build as it is")
    suite = first_to_fail(dict.fromkeys(suite for path in files for suite in suites_of(path)))
    if suite:
        sys.exit(f"mutate: {suite} fails without any change")


def judge(path, mutant, jobs):
    """'no', the suite that noticed, or None."""
    number, _, changed = mutant
    where = os.path.join(TREE, path)
    with open(where, encoding="utf-8") as f:
        original = f.read()
    lines = original.split("\n")
    lines[number - 1] = changed
    try:
        with open(where, "w", encoding="utf-8") as f:
            f.write("\n".join(lines))
        return "no" if build(jobs) else first_to_fail(suites_of(path))
    finally:
        with open(where, "w", encoding="utf-8") as f:
            f.write(original)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+")
    parser.add_argument("--sample", type=int, default=60, help="mutants in all; 0: every one")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--least", type=float, default=0.9)
    parser.add_argument("--list", action="store_true", help="print the mutants, run nothing")
    options = parser.parse_args()
    known = equivalent()
    chosen = [(path, m) for path in options.files for m in mutants_of(path)
              if f"{path}: {m[1].strip()} -> {m[2].strip()}" not in known]
    if options.sample and options.sample < len(chosen):
        chosen = random.Random(options.seed).sample(chosen, options.sample)
    chosen.sort(key=lambda one: (one[0], one[1][0]))
    if options.list:
        for path, (number, line, changed) in chosen:
            print(f"{path}:{number}: {line.strip()}  ->  {changed.strip()}")
        return 0
    prepare(options.jobs, sorted({path for path, _ in chosen}))
    noticed, survivors = 0, []
    for path, mutant in chosen:
        suite = judge(path, mutant, options.jobs)
        if suite == "no":
            continue
        text = f"{path}:{mutant[0]}: {mutant[1].strip()}  ->  {mutant[2].strip()}"
        print(f"{suite or 'SURVIVES':12} {text}", flush=True)
        noticed += suite is not None
        survivors += [] if suite else [text]
    total = noticed + len(survivors)
    print(f"\n{noticed} of {total} mutants noticed")
    for text in survivors:
        print(f"  survives: {text}")
    return 0 if total and noticed >= options.least * total else 1


if __name__ == "__main__":
    sys.exit(main())

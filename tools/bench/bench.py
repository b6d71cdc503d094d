#!/usr/bin/env python3
"""Times our simulation beside SciPy's on the same right-hand side, in one run.

Every program gets the loosest tolerance at which its error against an independent reference is at
most 1e-8; then all are timed in turn, round by round, by the thread's own CPU clock. What counts are
the ratios. Prints tables and writes build/bench.json.
"""
import ctypes
import json
import math
import os
import statistics
import subprocess
import sys
import time

ROUNDS = 9
TARGET = 1e-8
P = (0.0541, 0.0553, 0.0293, 0.7823, 0.3360, 0.1384, 0.1981)


def ensure_packages(build):
    """NumPy, SciPy and numba: as installed, or in a virtual environment under build/."""
    try:
        import numba, numpy, scipy  # noqa: F401
        return
    except ImportError:
        pass
    venv = os.path.join(build, "bench-venv")
    python = os.path.join(venv, "bin", "python")
    if sys.executable == os.path.abspath(python):
        sys.exit("bench: NumPy, SciPy and numba cannot be installed: their comparison is skipped")
    try:
        if not os.path.exists(python):
            print("bench: making a virtual environment in", venv, file=sys.stderr)
            subprocess.run([sys.executable, "-m", "venv", venv], check=True)
            subprocess.run([python, "-m", "pip", "install", "-q", "numpy", "scipy", "numba"],
                           check=True)
    except (OSError, subprocess.CalledProcessError):
        sys.exit("bench: skipped, NumPy, SciPy and numba are not there and cannot be installed")
    os.execv(python, [python] + sys.argv)


def load(path):
    lib = ctypes.CDLL(path)
    array = ctypes.c_void_p
    lib.bench_reference.argtypes = [array]
    lib.bench_fast.argtypes = [ctypes.c_int, ctypes.c_double, array]
    lib.bench_held.argtypes = [ctypes.c_int, ctypes.c_double, array]
    lib.bench_fast_held.argtypes = [ctypes.c_double, array]
    return lib


def peers():
    """name -> function(tolerance) -> 2001 x 4 array."""
    import numba
    import numpy as np
    from scipy.integrate import odeint, solve_ivp

    @numba.njit(fastmath=False)
    def rhs(t, x):
        p1, p2, p3, p4, p5, p6, p7 = P
        g = 9.81
        c2 = math.cos(x[1])
        s2 = math.sin(x[1])
        v1 = x[2]
        v2 = x[3]
        d11 = p1 + p2 + 2 * p3 * c2
        d12 = p2 + p3 * c2
        gc12 = p5 * g * math.cos(x[0] + x[1])
        r1 = (1.5 * math.sin(6 * t) - p6 * v1 - p7 * math.tanh(15 * v1)
              + p3 * s2 * (2 * v1 * v2 + v2 * v2) - p4 * g * math.cos(x[0]) - gc12)
        r2 = -p3 * s2 * v1 * v1 - gc12
        det = d11 * p2 - d12 * d12
        out = np.empty(4)
        out[0] = v1
        out[1] = v2
        out[2] = (p2 * r1 - d12 * r2) / det
        out[3] = (d11 * r2 - d12 * r1) / det
        return out

    t = np.linspace(0, 10, 2001)
    x0 = np.array([-math.pi / 2, 0, 0, 0])
    rhs(0.0, x0)  # compile

    def ivp(method):
        def run(tolerance):
            return solve_ivp(rhs, (0, 10), x0, method=method, t_eval=t, rtol=tolerance,
                             atol=tolerance).y.T
        return run

    def ode(tolerance):
        return odeint(rhs, x0, t, tfirst=True, rtol=tolerance, atol=tolerance, mxstep=100000)

    return {"solve_ivp LSODA + numba": ivp("LSODA"), "solve_ivp DOP853 + numba": ivp("DOP853"),
            "odeint + numba": ode}


def loosest(run, reference):
    """Loosest tolerance (by factors of 2) with error <= TARGET, and that error."""
    import numpy as np
    tolerance = 1e-6
    while tolerance > 3e-14:
        error = float(np.max(np.abs(run(tolerance) - reference)))
        # A lucky tolerance does not count: the next tighter one must hold too.
        if error <= TARGET and float(np.max(np.abs(run(tolerance / 2) - reference))) <= TARGET:
            return tolerance, error
        tolerance /= 2
    return None, None


def measure(programs, reference):
    settings = {}
    for name, (run, per) in programs.items():
        tolerance, error = loosest(run, reference)
        if tolerance is None:
            print(f"  {name}: skipped, it does not reach an error of {TARGET:g}")
        else:
            settings[name] = (tolerance, error)
    times = {name: [] for name in settings}
    for _ in range(ROUNDS):
        for name in settings:
            run, per = programs[name]
            repeat = 1
            while True:  # long enough for the clock
                start = time.thread_time()
                for _ in range(repeat):
                    run(settings[name][0])
                elapsed = time.thread_time() - start
                if elapsed > 0.02 or repeat > 4096:
                    break
                repeat *= 4
            times[name].append(elapsed / repeat / per)
    return {name: {"ms": 1e3 * statistics.median(times[name]), "tolerance": settings[name][0],
                   "error": settings[name][1]} for name in settings}


def table(title, rows, ours):
    print(f"\n{title}\n  {'':34s} {'ms':>9s} {'error':>9s} {'times ours':>11s}")
    for name, r in sorted(rows.items(), key=lambda kv: kv[1]["ms"]):
        print(f"  {name:34s} {r['ms']:9.4f} {r['error']:9.1e} {r['ms'] / rows[ours]['ms']:11.2f}")


def main():
    build, library = sys.argv[1], sys.argv[2]
    ensure_packages(build)
    import numpy as np
    lib = load(library)
    reference = np.empty((2001, 4))
    lib.bench_reference(reference.ctypes.data)

    def ours(count):
        out = np.empty((2001, 4))

        def run(tolerance):
            if not lib.bench_fast(count, tolerance, out.ctypes.data):
                raise RuntimeError("simulation failed")
            return out
        return run

    single, batch = "mechkit DOP853, one trajectory", "mechkit DOP853, each of a batch of 8"
    programs = {single: (ours(1), 1), batch: (ours(8), 8)}
    programs.update({name: (run, 1) for name, run in peers().items()})
    smooth = measure(programs, reference)
    table("10 s of the pendubot under 1.5 sin 6t, output each 5 ms, error <= 1e-8", smooth, single)

    held_reference = np.empty((5000, 4))
    lib.bench_fast_held(1e-14, held_reference.ctypes.data)

    def held(solver):
        out = np.empty((5000, 4))

        def run(tolerance):
            if not lib.bench_held(solver, tolerance, out.ctypes.data):
                return np.full((5000, 4), np.inf)
            return out
        return run

    def fast_held(tolerance):
        out = np.empty((5000, 4))
        lib.bench_fast_held(tolerance, out.ctypes.data)
        return out

    board = {"cvode-adams": (held(1), 1), "cvode-bdf": (held(2), 1), "arkode-erk": (held(3), 1),
             "DOP853": (fast_held, 1)}
    edges = measure(board, held_reference)
    table("the same with the command held for 2 ms, as the virtual board runs, error <= 1e-8", edges,
          "arkode-erk")

    ratio = smooth["solve_ivp LSODA + numba"]["ms"] / smooth[single]["ms"] \
        if "solve_ivp LSODA + numba" in smooth else float("nan")
    share = smooth[batch]["ms"] / smooth[single]["ms"]
    print(f"\n  one trajectory: {ratio:.0f} times faster than solve_ivp LSODA with numba")
    print(f"  a batch of 8 costs {share:.2f} of a single run for each trajectory")
    with open(os.path.join(build, "bench.json"), "w", encoding="utf-8") as f:
        json.dump({"smooth": smooth, "held": edges, "lsoda_ratio": ratio, "batch_share": share}, f,
                  indent=1)
    print(f"  figures: {os.path.join(build, 'bench.json')}")


if __name__ == "__main__":
    main()

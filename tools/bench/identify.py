"""Output error on 30 runs: mechkit beside SciPy's least_squares with LSODA, in one process.

Both estimate seven parameters and the four start states of every run, from parameters 20 % off. Each
gets data on which its command is exact, held between rows for mechkit, smooth for LSODA, which would
stop at every edge otherwise. SciPy's work grows with the number of runs, so it gets a few and its
time is scaled.
"""
import math
import time

import numpy as np

from simulation import P

TARGET_RATIO = 200
SCIPY_RUNS = 3
RUNS, ROWS, DT = 30, 2001, 0.005
NOISE = 2.0 * math.pi / 4000.0 / math.sqrt(12.0)
TOLERANCE = 1e-8  # of LSODA; tighter costs more and finds the same


def off(truth):
    return truth * np.where(np.arange(len(truth)) % 2, 0.8, 1.2)


def right_hand_side():
    import numba

    @numba.njit
    def rhs(t, x, p):
        g = 9.81
        c2, s2 = math.cos(x[1]), math.sin(x[1])
        v1, v2 = x[2], x[3]
        d11 = p[0] + p[1] + 2 * p[2] * c2
        d12 = p[1] + p[2] * c2
        gc12 = p[4] * g * math.cos(x[0] + x[1])
        r1 = (1.5 * math.sin(6 * t) - p[5] * v1 - p[6] * math.tanh(15 * v1)
              + p[2] * s2 * (2 * v1 * v2 + v2 * v2) - p[3] * g * math.cos(x[0]) - gc12)
        r2 = -p[2] * s2 * v1 * v1 - gc12
        det = d11 * p[1] - d12 * d12
        out = np.empty(4)
        out[0] = v1
        out[1] = v2
        out[2] = (p[1] * r1 - d12 * r2) / det
        out[3] = (d11 * r2 - d12 * r1) / det
        return out

    return rhs


def scipy_fit(truth, random):
    """Parameters and the thread's seconds for SCIPY_RUNS runs."""
    from scipy.integrate import solve_ivp
    from scipy.optimize import least_squares
    from scipy.sparse import lil_matrix
    rhs = right_hand_side()
    t = DT * np.arange(ROWS)
    rest = np.array([-math.pi / 2, 0.0, 0.0, 0.0])

    def run(p, start):
        y = solve_ivp(rhs, (0.0, t[-1]), rest + start, method="LSODA", t_eval=t, rtol=TOLERANCE,
                      atol=TOLERANCE, args=(p,)).y
        return y[:2].T.ravel() if y.shape[1] == ROWS else np.full(2 * ROWS, 10.0)

    clean = run(truth, np.zeros(4))
    data = clean + NOISE * random.standard_normal((SCIPY_RUNS, 2 * ROWS))
    n = len(truth)
    shape = lil_matrix((data.size, n + 4 * SCIPY_RUNS))
    shape[:, :n] = 1
    for i in range(SCIPY_RUNS):
        shape[2 * ROWS * i:2 * ROWS * (i + 1), n + 4 * i:n + 4 * i + 4] = 1

    # Start states are counted from 1: the differences' step is relative.
    def residuals(z):
        p, starts = z[:n] * truth, z[n:].reshape(SCIPY_RUNS, 4) - 1.0
        return (np.concatenate([run(p, s) for s in starts]) - data.ravel()) / NOISE

    first = np.concatenate([off(truth) / truth, np.ones(4 * SCIPY_RUNS)])
    begin = time.thread_time()
    fit = least_squares(residuals, first, jac_sparsity=shape, diff_step=1e-4, x_scale="jac",
                        tr_solver="lsmr", ftol=1e-6, xtol=1e-6, max_nfev=60)
    return fit.x[:n] * truth, time.thread_time() - begin, fit.nfev


def mechkit_data(lib, truth, random):
    """Noisy angles of all runs."""
    clean = np.empty((ROWS, 2))
    p = np.ascontiguousarray(truth)
    if not lib.bench_angles(p.ctypes.data, ROWS, clean.ctypes.data):
        raise RuntimeError("simulation failed")
    return np.ascontiguousarray(clean + NOISE * random.standard_normal((RUNS, ROWS, 2)))


def mechkit_fit(lib, truth, data, threads, checks, rounds=3):
    """Parameters and the median of the seconds for all runs: the thread's own if it is but one."""
    clock = time.thread_time if threads == 1 else time.perf_counter
    seconds = []
    for _ in range(rounds):
        p = np.ascontiguousarray(off(truth))
        begin = clock()
        if not lib.bench_identify(data.ctypes.data, RUNS, ROWS, threads, checks, p.ctypes.data):
            raise RuntimeError("identification failed")
        seconds.append(clock() - begin)
    return p, sorted(seconds)[rounds // 2]


def rows(context):
    truth, random = np.array(P), np.random.default_rng(1)
    data = mechkit_data(context.lib, truth, random)
    fitted, fit = mechkit_fit(context.lib, truth, data, 1, False)
    alone, seconds = mechkit_fit(context.lib, truth, data, 1, True)
    ours, wall = mechkit_fit(context.lib, truth, data, 0, True)
    theirs, part, evaluations = scipy_fit(truth, random)
    scaled = part * RUNS / SCIPY_RUNS
    result = {"mechkit_s": wall, "mechkit_one_thread_s": seconds, "mechkit_fit_s": fit,
              "scipy_s": scaled, "scipy_runs": SCIPY_RUNS, "ratio": scaled / wall,
              "ratio_one_thread": scaled / seconds, "ratio_fit": scaled / fit,
              "target_ratio": TARGET_RATIO}

    def worst(p):
        return 100.0 * float(np.max(np.abs(p / truth - 1.0)))

    print(f"\nOutput error, {RUNS} runs of 10 s at 200 Hz from 20 % off, start states unknown")
    print(f"  {'':44s} {'s':>10s} {'off by':>9s} {'times ours':>11s}")
    for name, s, p in (("mechkit identify, as installed (all processors)", wall, ours),
                       ("mechkit identify, one thread", seconds, alone),
                       ("its fit alone, data not checked, one thread", fit, fitted),
                       ("least_squares, LSODA + numba", scaled, theirs)):
        print(f"  {name:44s} {s:10.3f} {worst(p):8.4f}% {s / wall:11.1f}")
    print(f"  (least_squares took {part:.1f} s for {SCIPY_RUNS} runs and {evaluations} evaluations: "
          f"scaled to {RUNS})")
    print(f"  target {TARGET_RATIO} times thread for thread: "
          f"{'met' if result['ratio_fit'] >= TARGET_RATIO else 'missed'} by the fit, "
          f"{result['ratio_fit']:.0f} times; {result['ratio_one_thread']:.0f} times with its checks")
    return result

"""Derivatives of 10 s of the pendubot by its 7 parameters and 4 start values, to 1e-7 of the largest;
and many trajectories at once."""
import ctypes
import math

import numpy as np

from environment import has
from harness import Program, measure, table
from simulation import P, ROWS, START, TOLERANCES, heyoka_system

TARGET = 1e-7
COLUMNS = 11


def heyoka_peer(held):
    """Variational equations by heyoka, under 1.5 sin 6t or under that held for 5 ms."""
    import heyoka as hy
    command = hy.par[7] if held else None
    system = hy.var_ode_sys(heyoka_system([hy.par[i] for i in range(7)], command),
                            hy.var_args.vars | hy.var_args.params, order=1)
    grid = np.linspace(0, 10, ROWS)
    made, begin = {}, {}

    def run(tol):
        if tol not in made:  # compiling is not part of the work
            pars = list(P) + ([0.0] if held else [])
            made[tol] = hy.taylor_adaptive(system, list(START), pars=pars, tol=tol,
                                           compact_mode=True)
            begin[tol] = np.array(made[tol].state)
        ta = made[tol]
        ta.time, ta.state[:] = 0.0, begin[tol]
        if not held:
            return ta.propagate_grid(grid)[-1]
        out = np.empty((ROWS, len(ta.state)))
        out[0] = ta.state
        for k in range(1, ROWS):
            ta.pars[7] = 1.5 * math.sin(6 * grid[k - 1])
            ta.propagate_until(grid[k])
            out[k] = ta.state
        return out

    return run


def rows(context):
    lib = context.lib

    def ours(step):
        out = np.empty((2 * (ROWS - 1), COLUMNS))
        if not lib.bench_derivatives(ctypes.c_double(step), out.ctypes.data):
            raise RuntimeError("shooting failed")
        return out

    exact = ours(0.005 / 32)
    scale = np.abs(exact).max(axis=0)

    def error(result):
        return float(np.max(np.abs(result - exact) / scale))

    name = "mechkit shooting, exact derivatives"
    result = measure({name: Program(ours, [0.005 / n for n in (1, 2, 4, 8, 16)])}, error, TARGET)
    for held in (True, False) if has("heyoka") else ():
        run = heyoka_peer(held)
        reference = run(1e-15)
        size = np.abs(reference).max(axis=0)
        size[size == 0.0] = 1.0
        peer = "heyoka, variational, " + ("command held" if held else "smooth command")
        result.update(measure({peer: Program(run, [1e-5 / 4 ** k for k in range(15)])},
                              lambda r: float(np.max(np.abs(r - reference) / size)), TARGET))
    table("derivatives by 7 parameters and 4 start values, error <= 1e-7 (ours under a command held "
          "for 5 ms)", result, name, 0.6)
    return result


def batches(context):
    """Per trajectory of 1024, each from its own start, error 1e-8 of the first."""
    lib, count = context.lib, 1024
    reference = np.empty((ROWS, 4))
    lib.bench_reference(reference.ctypes.data)

    def ours(tol):
        out = np.empty((ROWS, 4))
        if not lib.bench_many(count, ctypes.c_double(tol), out.ctypes.data):
            raise RuntimeError("simulation failed")
        return out

    programs = {"mechkit, each of 1024": Program(ours, TOLERANCES, per=count)}
    if has("heyoka"):
        import heyoka as hy
        grid, made = np.linspace(0, 10, ROWS), {}
        starts = np.array([[s] * 8 for s in START])

        def peer(tol):
            if tol not in made:
                made[tol] = hy.taylor_adaptive_batch(heyoka_system(), starts.copy(), tol=tol)
            ta = made[tol]
            ta.set_time(0.0)
            ta.state[:] = starts
            out = ta.propagate_grid(np.repeat(grid[:, None], 8, axis=1))
            return out[-1][:, :, 0] if isinstance(out, tuple) else out[:, :, 0]

        programs["heyoka, each of a batch of 8"] = Program(peer, [1e-4 / 2 ** k for k in range(30)],
                                                          per=8)

    def error(result):
        return float(np.max(np.abs(result - reference))) if np.shape(result) == (ROWS, 4) \
            else math.inf

    result = measure(programs, error, 1e-8)
    table("many trajectories, per trajectory on one core, error <= 1e-8", result,
          "mechkit, each of 1024", 0.08)
    return result

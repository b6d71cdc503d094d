"""One trajectory: 10 s of the pendubot from hanging under 1.5 sin 6t, output every 5 ms, each program at
the loosest setting with an error of at most 1e-8."""
import ctypes
import math

import numpy as np

from environment import has
from harness import Program, measure, table

TARGET = 1e-8
P = (0.0541, 0.0553, 0.0293, 0.7823, 0.3360, 0.1384, 0.1981)
TOLERANCES = [1e-6 / 2 ** k for k in range(25)]
ROWS = 2001
START = (-math.pi / 2, 0.0, 0.0, 0.0)


def numba_rhs():
    """f(t, x) -> dx, compiled."""
    import numba

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

    rhs(0.0, np.array(START))
    return rhs


def scipy_peers():
    from scipy.integrate import odeint, solve_ivp
    rhs, t, x0 = numba_rhs(), np.linspace(0, 10, ROWS), np.array(START)

    def ivp(method):
        return lambda tol: solve_ivp(rhs, (0, 10), x0, method=method, t_eval=t, rtol=tol,
                                     atol=tol).y.T

    def ode(tol):
        return odeint(rhs, x0, t, tfirst=True, rtol=tol, atol=tol, mxstep=100000)

    return {"solve_ivp LSODA + numba": Program(ivp("LSODA"), TOLERANCES),
            "solve_ivp DOP853 + numba": Program(ivp("DOP853"), TOLERANCES),
            "odeint + numba": Program(ode, TOLERANCES)}


def numbalsoda_peers():
    if not has("numbalsoda"):
        return {}
    import numba
    from numbalsoda import dop853, lsoda, lsoda_sig
    rhs, t, x0 = numba_rhs(), np.linspace(0, 10, ROWS), np.array(START)

    @numba.cfunc(lsoda_sig)
    def f(time, x, dx, _data):
        d = rhs(time, numba.carray(x, (4,)))
        for i in range(4):
            dx[i] = d[i]

    address = f.address
    return {"numbalsoda lsoda": Program(lambda tol: lsoda(address, x0, t, rtol=tol, atol=tol)[0],
                                        TOLERANCES),
            "numbalsoda dop853": Program(lambda tol: dop853(address, x0, t, rtol=tol, atol=tol)[0],
                                         TOLERANCES)}


def heyoka_system(parameters=P, command=None):
    """[(state, derivative)] as expressions; the command is 1.5 sin 6t, or the one given."""
    import heyoka as hy
    command = 1.5 * hy.sin(6. * hy.time) if command is None else command
    q1, q2, v1, v2 = hy.make_vars("q1", "q2", "v1", "v2")
    p1, p2, p3, p4, p5, p6, p7 = parameters
    g, c2, s2 = 9.81, hy.cos(q2), hy.sin(q2)
    d11, d12 = p1 + p2 + 2. * p3 * c2, p2 + p3 * c2
    gc12 = p5 * g * hy.cos(q1 + q2)
    r1 = (command - p6 * v1 - p7 * hy.tanh(15. * v1)
          + p3 * s2 * (2. * v1 * v2 + v2 * v2) - p4 * g * hy.cos(q1) - gc12)
    r2 = -p3 * s2 * v1 * v1 - gc12
    det = d11 * p2 - d12 * d12
    return [(q1, v1), (q2, v2), (v1, (p2 * r1 - d12 * r2) / det),
            (v2, (d11 * r2 - d12 * r1) / det)]


def heyoka_peers():
    if not has("heyoka"):
        return {}
    import heyoka as hy
    grid = np.linspace(0, 10, ROWS)
    made = {}

    def run(tol):
        if tol not in made:  # compiling is not part of the work
            made[tol] = hy.taylor_adaptive(heyoka_system(), list(START), tol=tol)
        ta = made[tol]
        ta.time, ta.state[:] = 0.0, START
        return ta.propagate_grid(grid)[-1]

    return {"heyoka, Taylor": Program(run, [1e-4 / 2 ** k for k in range(30)])}


MUJOCO = """<mujoco><option integrator="RK4" timestep="0.000625" gravity="0 0 -9.81"><flag
contact="disable" constraint="disable"/></option><worldbody><body><joint name="j1" axis="0 1 0"
damping="{p6}"/><inertial pos="{c1} 0 0" mass="{m1}" diaginertia="{i1} {i1} {i1}"/><body pos="{l1} 0
0"><joint name="j2" axis="0 1 0"/><inertial pos="{c2} 0 0" mass="{m2}" diaginertia="{i2} {i2} {i2}"/>
</body></body></worldbody><actuator><motor joint="j1"/></actuator></mujoco>"""


def mujoco_peers():
    """The same masses and lengths without the steep friction, which MuJoCo has no law for: fixed
    steps of 0.625 ms, at which the plain loop is exact enough. Its error is not compared."""
    if not has("mujoco"):
        return {}
    import mujoco
    l1, m2 = 0.2, 2.0  # any: five parameters, seven numbers
    c2 = P[2] / (m2 * l1)
    m1 = (P[3] - m2 * l1) / 0.1
    model = mujoco.MjModel.from_xml_string(MUJOCO.format(
        p6=P[5], l1=l1, m1=m1, c1=0.1, i1=max(1e-3, P[0] - m1 * 0.01 - m2 * l1 ** 2), m2=m2, c2=c2,
        i2=max(1e-3, P[1] - m2 * c2 ** 2)))
    data = mujoco.MjData(model)
    drive = 1.5 * np.sin(6 * 0.000625 * np.arange(16000))

    def run(_level):
        mujoco.mj_resetData(model, data)
        out = np.empty((ROWS, 2))
        for k in range(16000):
            if k % 8 == 0:
                out[k // 8] = data.qpos
            data.ctrl[0] = drive[k]
            mujoco.mj_step(model, data)
        return out

    return {"MuJoCo RK4, 0.625 ms": Program(run, note="no steep friction; error not compared")}


def rows(context):
    lib = context.lib
    reference = np.empty((ROWS, 4))
    lib.bench_reference(reference.ctypes.data)

    def ours(count):
        out = np.empty((ROWS, 4))

        def run(tol):
            if not lib.bench_many(count, ctypes.c_double(tol), out.ctypes.data):
                raise RuntimeError("simulation failed")
            return out
        return run

    def plain(substeps):
        out = np.empty((ROWS, 4))
        lib.bench_rk4(substeps, out.ctypes.data)
        return out

    single = "mechkit, collocation"
    programs = {single: Program(ours(1), TOLERANCES),
                "mechkit DOP853, each of a batch of 8": Program(ours(8), TOLERANCES, per=8),
                "plain C loop, fixed-step RK4": Program(plain, [1, 2, 4, 8, 16, 32, 64, 128])}
    for peers in (heyoka_peers, numbalsoda_peers, scipy_peers, mujoco_peers):
        programs.update(peers())

    def error(result):
        return float(np.max(np.abs(result - reference))) if np.shape(result) == np.shape(
            reference) else math.inf

    result = measure(programs, error, TARGET)
    table("10 s of the pendubot under 1.5 sin 6t, output each 5 ms, error <= 1e-8", result, single,
          0.3)
    return result


def held(context):
    """Our own solvers under commands that are held for 2 ms, as the virtual board runs."""
    lib = context.lib
    reference = np.empty((5000, 4))
    lib.bench_fast_held(ctypes.c_double(1e-14), reference.ctypes.data)

    def solver(number):
        out = np.empty((5000, 4))

        def run(tol):
            if not lib.bench_held(number, ctypes.c_double(tol), out.ctypes.data):
                return np.full((5000, 4), np.inf)
            return out
        return run

    def fast(tol):
        out = np.empty((5000, 4))
        lib.bench_fast_held(ctypes.c_double(tol), out.ctypes.data)
        return out

    programs = {"cvode-adams": Program(solver(1), TOLERANCES),
                "cvode-bdf": Program(solver(2), TOLERANCES),
                "arkode-erk": Program(solver(3), TOLERANCES), "DOP853": Program(fast, TOLERANCES)}
    result = measure(programs, lambda r: float(np.max(np.abs(r - reference))), TARGET)
    table("the same with the command held for 2 ms, as the virtual board runs, error <= 1e-8",
          result, "arkode-erk")
    return result

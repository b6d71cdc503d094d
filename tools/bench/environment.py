"""The packages of the peers: as installed, or in a virtual environment under build/."""
import importlib.util
import os
import subprocess
import sys

NEEDED = ("numpy", "scipy", "numba")
PEERS = ("heyoka", "numbalsoda", "mujoco", "pandas")  # each may be missing


def has(name):
    return importlib.util.find_spec(name) is not None


def install(python, *names):
    """True when pip had them ready to use: compiling a peer could take longer than the bench."""
    command = [python, "-m", "pip", "install", "-q", "--only-binary=:all:", *names]
    try:
        return subprocess.run(command, capture_output=True, timeout=600,
                              check=False).returncode == 0
    except subprocess.TimeoutExpired:
        return False


def prepare(build):
    """Returns when all is there that can be had; may start this program again inside the
    environment. Prints what is left out."""
    venv = os.path.join(build, "bench-venv")
    python = os.path.join(venv, "bin", "python")
    inside = sys.prefix == os.path.abspath(venv)
    if not inside:
        if all(has(name) for name in NEEDED + PEERS):
            return
        try:
            if not os.path.exists(python):
                print("bench: making a virtual environment in", venv, file=sys.stderr)
                # Without the system's packages: a SciPy from there does not go with a newer NumPy.
                subprocess.run([sys.executable, "-m", "venv", venv], check=True)
        except (OSError, subprocess.CalledProcessError):
            sys.exit("bench: skipped, a virtual environment cannot be made")
        os.execv(python, [python, "-B"] + sys.argv)
    marker = os.path.join(venv, "tried")
    missing = [name for name in NEEDED if not has(name)]
    if missing and not install(sys.executable, *missing):
        sys.exit("bench: skipped, cannot be installed: " + ", ".join(missing))
    if not os.path.exists(marker):
        for name in PEERS:  # one by one: one that cannot be had must not stop the others
            if not has(name):
                install(sys.executable, name)
        with open(marker, "w", encoding="utf-8") as file:
            file.write("peers that are missing could not be installed; remove this to try again\n")
        importlib.invalidate_caches()
    for name in PEERS:
        if not has(name):
            print(f"bench: {name} is skipped: it is not there and cannot be installed")

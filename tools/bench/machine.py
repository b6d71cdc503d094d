"""What a bench met: processor, governor, load. Figures without these say little."""
import glob
import os
import re
import time

UNKNOWN = "not told"


def _first_line(path):
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return file.readline().strip()
    except OSError:
        return ""


def processor():
    """Name of the first processor."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            found = re.search(r"^model name\s*:\s*(.+)$", file.read(), re.M)
    except OSError:
        found = None
    return found[1].strip() if found else UNKNOWN


def governors():
    """Governors of the processors' clocks; a virtual machine does not tell."""
    told = {_first_line(path)
            for path in glob.glob("/sys/devices/system/cpu/cpu*/cpufreq/scaling_governor")}
    return ", ".join(sorted(told - {""})) or UNKNOWN


def stolen():
    """Seconds that the host took from this virtual machine since it started, or None."""
    fields = _first_line("/proc/stat").split()
    return int(fields[8]) / os.sysconf("SC_CLK_TCK") if len(fields) > 8 else None


def look():
    return {"date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), "processor": processor(),
            "processors": os.cpu_count(), "governor": governors(), "load": os.getloadavg()[0],
            "stolen_s": stolen()}


def describe(met):
    return (f"{met['processors']} x {met['processor']}, governor {met['governor']}, "
            f"load {met['load']:.1f}")

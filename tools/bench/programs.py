"""What programs of their own measure: lateness of the loop beside cyclictest, round trips over the wire,
seconds of explain a case."""
import re
import statistics
import subprocess


def run(command, timeout):
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)
    return done.stdout


def lateness(context):
    """p50, p99, p99.9 and the largest, us, as `make latency` prints them."""
    text = run([f"{context.build}/release/latency", str(context.seconds)],
               20 * context.seconds + 120)
    print("\nlateness of samples at 1 kHz\n" + text.rstrip())
    pattern = re.compile(r"^\s*(\w[\w ]*?)\s+(\d+) samples\s+(\d+) lost\s+p50\s+(\d+)\s+p99\s+(\d+)"
                         r"\s+p99\.9\s+(\d+)\s+max\s+(\d+)", re.M)
    return [{"who": m[1], "samples": int(m[2]), "lost": int(m[3]), "p50_us": int(m[4]),
             "p99_us": int(m[5]), "p999_us": int(m[6]), "max_us": int(m[7])}
            for m in pattern.finditer(text)]


def handover(context):
    """ns that the real-time thread pays for a row, on a busy machine, as `make handover` prints them."""
    text = run([f"{context.build}/release/handover", str(context.seconds)],
               2 * context.seconds + 60)
    print("\nhanding a row to the log\n" + text.rstrip())
    figures = re.search(r"rows (\d+)\s+full (\d+)\s+p50 (\d+)\s+p99 (\d+)\s+p99\.9 (\d+)\s+max (\d+)",
                        text)
    if not figures:
        return {}
    names = ("rows", "full", "p50_ns", "p99_ns", "p999_ns", "max_ns")
    histogram = {int(below): int(rows)
                 for below, rows in re.findall(r"^\s*>?\s*(\d+)\s+(\d+) #", text, re.M)}
    return {**dict(zip(names, map(int, figures.groups()))), "rows_below_ns": histogram}


def round_trip(context):
    text = run([f"{context.build}/release/roundtrip", str(context.seconds)],
               5 * context.seconds + 60)
    print("\nround trips through libusb, emulated board\n" + text.rstrip())
    return {"text": text.strip()}


def explain(context):
    """Seconds a case with a hidden effect, one thread."""
    if context.cases == 0:
        return {}
    text = run([f"{context.build}/release/mechkit-challenge", "--cases", str(context.cases),
                "--kind", "single", "--jobs", "1", "--threads", "1"], 300 * context.cases)
    seconds = [float(s) for s in re.findall(r"\s(\d+\.\d) s(?:\s|$)", text)]
    if not seconds:
        return {}
    print(f"\nexplain, {len(seconds)} cases, one thread: median {statistics.median(seconds):.1f} s, "
          f"largest {max(seconds):.1f} s")
    return {"seconds": seconds, "median_s": statistics.median(seconds)}

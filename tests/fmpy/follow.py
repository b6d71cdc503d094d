"""FMPy validates an FMU and drives it by the command of a log, from the state in the first row of a
prediction (simulate --states); its readings must be those of the prediction.

    follow.py RIG.fmu LOG.csv PREDICTION.csv
"""
import csv
import sys

import fmpy
import numpy
from fmpy.validation import validate_fmu

TOLERANCE = 1e-6  # rad


def columns(path):
    with open(path) as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    return dict(zip(rows[0], numpy.array([[float(x or "nan") for x in row] for row in rows[1:]]).T))


unit, log, prediction = sys.argv[1], columns(sys.argv[2]), columns(sys.argv[3])
problems = validate_fmu(unit)
assert not problems, problems

description = fmpy.read_model_description(unit)
starts = [v.name for v in description.modelVariables if v.name.endswith("_start")]
start_values = {name: prediction[f"x{i + 1}"][0] for i, name in enumerate(starts)}
start_values["effects_start_at_rest"] = False
angles = [q for q in ("q1", "q2") if q in prediction]
command = numpy.array(list(zip(log["t"], log["u"])), dtype=[("time", "f8"), ("u", "f8")])
result = fmpy.simulate_fmu(
    unit,
    start_time=log["t"][0],
    stop_time=log["t"][-1],
    output_interval=log["t"][1] - log["t"][0],
    start_values=start_values,
    input=command,
    output=angles,
)
assert len(result) == len(log["t"]), (len(result), len(log["t"]))
error = max(numpy.abs(result[q] - prediction[q]).max() for q in angles)
travel = numpy.ptp(prediction[angles[-1]])
print(f"{len(starts)} states, {len(result)} rows, {angles[-1]} moves {travel:.3g} rad, error {error:.3g} rad")
assert error < TOLERANCE < travel, error

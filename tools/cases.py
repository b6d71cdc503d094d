"""Cases with answers: made-up logs of rigs beside what is true of them."""
import glob
import json
import os
import sys


def shared():
    """The folder of measured and made-up logs: $MECHKIT_SHARED, or ../shared beside the source tree."""
    here = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    return os.environ.get("MECHKIT_SHARED", os.path.join(here, "..", "shared"))


class Case:
    """A folder with a given model and logs, and its answer."""

    def __init__(self, folder, answer):
        self.name = os.path.basename(answer)[:-len(".json")]
        with open(answer) as file:
            self.truth = json.load(file)
        self.model = f"{folder}/{self.name}/base.ini"
        self.train = sorted(glob.glob(f"{folder}/{self.name}/train_*"))
        self.holdout = f"{folder}/{self.name}/holdout_1.csv.gz"
        self.holdout_truth = f"{folder}/truth/{self.name}_holdout.csv.gz"


def cases(wanted, folder="challenge"):
    """All cases of a folder, or those named (case_007 or 007). Without it none: then says so."""
    folder = os.path.join(shared(), folder)
    found = [Case(folder, answer) for answer in sorted(glob.glob(f"{folder}/truth/case_*.json"))]
    if not found:
        print(f"SKIPPED: no cases with answers in {folder}")
        return []
    names = {name for case in found for name in (case.name, case.name[len("case_"):])}
    for name in wanted:
        if name not in names:
            sys.exit(f"there is no case {name} in {folder}")
    return [c for c in found if not wanted or c.name in wanted or c.name[len("case_"):] in wanted]

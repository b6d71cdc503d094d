#!/bin/sh
# Runs the tests of a coverage build and prints lines and branches by folder: tools/coverage.sh DIR
# [SUITE...]. The whole report is DIR/coverage.html.
set -eu
dir=$1
shift
command -v gcovr >/dev/null || { echo "gcovr is not installed: apt-get install gcovr" >&2; exit 1; }
find "$dir" -name '*.gcda' -delete
"$dir/mechkit-tests" "$@" || echo "some tests failed: the figures below are of the others too"
gcovr --root . --object-directory "$dir" --filter 'src/' --exclude-throw-branches --gcov-ignore-parse-errors \
    --json-summary "$dir/coverage.json" --html-details "$dir/coverage.html" --print-summary \
    "$dir" >"$dir/coverage.txt"
python3 - "$dir/coverage.json" <<'EOF'
import json
import sys

folders = {}
for file in json.load(open(sys.argv[1], encoding="utf-8"))["files"]:
    folder = file["filename"].rsplit("/", 1)[0]
    sums = folders.setdefault(folder, [0, 0, 0, 0])
    for i, key in enumerate(("line_covered", "line_total", "branch_covered", "branch_total")):
        sums[i] += file[key]
folders["all"] = [sum(column) for column in zip(*folders.values())]
print(f"{'folder':16s} {'lines':>18s} {'branches':>18s}")
for folder, (line, lines, branch, branches) in folders.items():
    print(f"{folder:16s} {line:6d}/{lines:<6d} {100 * line / max(lines, 1):4.0f} % "
          f"{branch:6d}/{branches:<6d} {100 * branch / max(branches, 1):4.0f} %")
EOF

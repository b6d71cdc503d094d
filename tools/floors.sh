#!/bin/sh
# Checks who includes whom: a folder includes only folders on floors below it, or its own (src/README.md);
# one file alone knows SUNDIALS; Eigen stays in C++; only the screen knows curses.
set -eu
cd "$(dirname "$0")/.."
bad=0

complain() { # TITLE LINES
    [ -z "$2" ] && return
    printf '%s\n%s\n' "$1" "$2" >&2
    bad=1
}

floor() {
    case $1 in
    base) echo 1 ;;
    model) echo 2 ;;
    sim | ctrl) echo 3 ;;
    driver | ident) echo 4 ;;
    explain) echo 5 ;;
    console) echo 6 ;;
    esac
}

for folder in base model sim ctrl driver ident explain console; do
    [ -d "src/$folder" ] || continue
    for other in base model sim ctrl driver ident explain console; do
        [ "$other" = "$folder" ] && continue
        [ "$(floor "$other")" -lt "$(floor "$folder")" ] && continue
        found=$(grep -rnE "^[[:space:]]*#[[:space:]]*include \"$other/" "src/$folder" || true)
        complain "src/$folder must not include src/$other:" "$found"
    done
done
complain "only src/sim/sundials.cpp includes SUNDIALS:" \
    "$(grep -rnE '#include <(arkode|cvode|cvodes|ida|nvector|sundials|sunlinsol|sunmatrix|sunnonlinsol)/' \
        src include tests | grep -v '^src/sim/sundials.cpp' || true)"
complain "Eigen stays in C++ sources:" \
    "$(grep -rnE '#include <(unsupported/)?Eigen' src include | grep -vE '^src/[a-z]+/[a-z_]+\.(cpp|hpp):' || true)"
complain "only the screen (src/console/ui_*.c) includes curses:" \
    "$(grep -rnE '#include <n?curses' src include | grep -v '^src/console/ui_' || true)"
exit $bad

#!/bin/sh
# Finds files of one folder that need each other: `tools/circles.sh BUILD` reads the object files
# under BUILD/src and prints what tsort(1) says of every circle of calls. Parts of one class count as
# one file. Objects whose source is gone are passed over.
set -eu
cd "$(dirname "$0")/.."
objects=$1/src
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# The file that an object belongs to, without its ending; a kernel that is compiled several times is
# one file.
parts='s/[.][^/]*$//
s#/fit_\(states\|shoot\|eliminate\|own\)$#/fit#
s#/free_runs_\(windows\|folds\)$#/free_runs#
s#/search/trials$#/search/search#
s#/search/causes_\(forms\|sharpness\|simpler\)$#/search/causes#
s#/search/full_fits$#/search/search#'

find "$objects" -name '*.o' | sort | while read -r o; do
    source=${o#"$objects"/}
    source=src/${source%%.*}
    [ -e "$source.c" ] || [ -e "$source.cpp" ] || [ -e "$source.cc" ] || continue
    file=$(printf '%s\n' "${o#"$objects"/}" | sed "$parts")
    nm -g "$o" | awk -v file="$file" 'NF == 3 && $2 ~ /[TDBR]/ { print "d", $3, file }
        NF == 2 && $1 == "U" { print "u", $2, file }'
done >"$work/symbols"

# Pairs of files of a folder, who calls first.
awk '
    function folder(file) { sub("/[^/]*$", "", file); return file }
    $1 == "d" { owner[$2] = $3 }
    $1 == "u" { needs[++n] = $2; by[n] = $3 }
    END {
        for (i = 1; i <= n; i++) {
            to = owner[needs[i]]
            if (to != "" && to != by[i] && folder(to) == folder(by[i]))
                print by[i], to
        }
    }' "$work/symbols" | sort -u >"$work/pairs"
[ -s "$work/symbols" ] || {
    echo "circles: no object files under $objects: make first" >&2
    exit 1
}
if ! tsort "$work/pairs" >/dev/null 2>"$work/circles"; then
    echo "files of a folder that need each other:" >&2
    sed -n '/contains a loop/d; s/^tsort: \(.*\/.*\)$/  \1/p' "$work/circles" >&2
    exit 1
fi

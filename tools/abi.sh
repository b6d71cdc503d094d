#!/bin/sh
# Holds the shared library against the public headers: it has every function that they declare, with
# the version that the map gives it, and nothing else. tools/abi.sh LIBRARY [HEADERS MAP]
set -eu
here=$(dirname "$0")/..
library=$1
headers=${2:-$here/include/mechkit}
map=${3:-$here/src/libmechkit.map}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# The compiler lists what it saw declared, with the file it was declared in.
for h in "$headers"/*.h; do
    "${CC:-cc}" -std=c11 -I"$headers/.." -fsyntax-only -x c -aux-info "$work/declared" "$h"
    grep -F "/* $h:" "$work/declared" | grep ' extern ' |
        sed 's/^[^(]*[ *]\([a-z0-9_]*\) (.*/\1/' || true
done | sort -u >"$work/headers"
sed -n 's/^ *\(mk_[a-z0-9_]*\);.*/\1/p' "$map" | sort >"$work/map"
nm -D --defined-only "$library" | awk '$2 != "A" {print $3}' | sort >"$work/exported"
sed -n 's/^\([a-z0-9_]*\)@@MECHKIT_[0-9.]*$/\1/p' "$work/exported" >"$work/library"

status=0
complain() { # A B TEXT: what is in A and not in B
    names=$(comm -23 "$work/$1" "$work/$2" | tr '\n' ' ')
    [ -z "$names" ] && return
    echo "abi: $3: $names" >&2
    status=1
}
complain headers map "declared in a header, missing in the map"
complain map headers "in the map, declared in no header"
complain map library "in the map, not in the library"
complain library map "in the library, not in the map"
if [ "$(wc -l <"$work/exported")" != "$(wc -l <"$work/library")" ]; then
    echo "abi: exported without a version: $(grep -v '@@MECHKIT_' "$work/exported" | tr '\n' ' ')" >&2
    status=1
fi
[ "$(wc -l <"$work/library")" -gt 0 ] || status=1
exit $status

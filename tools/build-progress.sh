#!/bin/sh
# Reads what make says, and "exit CODE" at its end: into the file $1, while a count of what has been
# built shows that it is alive. Where make failed, all that it said, and its code.
set -eu
log=$1
built=0 code=1
: >"$log"
while IFS= read -r line; do
    printf '%s\n' "$line" >>"$log"
    case $line in
    "exit "*) code=${line#exit } ;;
    "  CC "* | "  CXX "* | "  LD "* | "  AR "*)
        built=$((built + 1))
        if [ -t 1 ]; then
            printf '\r  %d files built' "$built"
        elif [ $((built % 25)) = 0 ]; then
            printf '  %d files built\n' "$built"
        fi ;;
    esac
done
if [ -t 1 ] && [ "$built" -gt 0 ]; then
    echo
fi
[ "$code" = 0 ] || cat "$log" >&2
exit "$code"

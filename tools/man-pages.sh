#!/bin/sh
# Writes a man page for every subcommand from what the program says of itself, so that there is one
# text: tools/man-pages.sh PROGRAM DIRECTORY
set -eu
program=$1
out=$2
version=$("$program" --version)
day=$(date -u -r "$program" '+%B %-d, %Y')
mkdir -p "$out"

# Backslashes and leading dots and quotes mean something to the formatter.
plain() {
    sed -e 's/\\/\\e/g' -e "s/^[.']/\\\\\\&&/"
}

"$program" --help | sed -n 's/^  \([a-z][a-z-]*\)  *\(.*\)$/\1 \2/p' | while read -r name summary; do
    help=$("$program" "$name" --help)
    upper=$(printf 'mechkit-%s' "$name" | tr '[:lower:]' '[:upper:]')
    {
        printf '.Dd %s\n.Dt %s 1\n.Os "%s"\n' "$day" "$upper" "$version"
        printf '.Sh NAME\n.Nm mechkit-%s\n.Nd %s\n' "$name" "$(printf '%s' "$summary" | plain)"
        printf '.Sh SYNOPSIS\n.Bd -literal\n'
        printf '%s\n' "$help" | sed '/^$/,$d' | sed 's/^usage: /       /' | plain
        printf '.Ed\n.Sh DESCRIPTION\n.Bd -literal\n'
        printf '%s\n' "$help" | sed '1,/^$/d' | plain
        printf '.Ed\n.Sh EXIT STATUS\n0 success, 1 the run or the check failed, 2 wrong usage, '
        printf '3 bad input file.\n.Sh SEE ALSO\n.Xr mechkit 1\n'
    } >"$out/mechkit-$name.1"
done

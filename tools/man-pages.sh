#!/bin/sh
# Writes the man pages from what the program says of itself, so that there is one text: one of every
# subcommand from its --help, and mechkit(1) from its template with the list of commands put in.
#     tools/man-pages.sh PROGRAM DIRECTORY
set -eu
program=$1
out=$2
here=$(dirname "$0")/..
version=$("$program" --version)
built=${SOURCE_DATE_EPOCH:-$(date -r "$program" +%s)} # packages of the same source are the same
day=$(date -u -d "@$built" '+%B %-d, %Y')
mkdir -p "$out"

# Backslashes and leading dots and quotes mean something to the formatter.
plain() {
    sed -e 's/\\/\\e/g' -e "s/^[.']/\\\\\\&&/"
}

commands() { # name and summary of every subcommand, a line each
    "$program" --help | sed -n 's/^  \([a-z][a-z-]*\)  *\(.*\)$/\1 \2/p'
}

# --help as mdoc: usage, paragraphs, options as a list.
page() {
    awk '
    function option(line,    flag, rest, i) {
        flag = substr(line, 5)
        i = match(flag, /  +/)
        rest = i ? substr(flag, i + RLENGTH) : ""
        flag = i ? substr(flag, 1, i - 1) : flag
        i = index(flag, " ")
        if (i)
            print ".It Fl \\&-" substr(flag, 1, i - 1) " Ar " substr(flag, i + 1)
        else
            print ".It Fl \\&-" flag
        if (rest != "")
            print rest
    }
    BEGIN { print ".Sh SYNOPSIS\n.Bd -literal" }
    part == 0 && /^$/ { print ".Ed\n.Sh DESCRIPTION\n.Bd -literal"; part = 1; next }
    part == 1 && /^$/ { blank = 1; next } # none before the options
    part == 0 { sub(/^usage: /, "       "); print; next }
    /^  --/ {
        if (part == 1) print ".Ed\n.Sh OPTIONS\n.Bl -tag -width Ds"
        part = 2
        blank = 0
        option($0)
        next
    }
    part == 2 && /^$/ { print ".El\n.Pp"; part = 3; next }
    part == 2 { sub(/^ +/, "") }
    { if (blank) print ""; blank = 0; print }
    END { if (part < 3) print part == 1 ? ".Ed" : ".El" }'
}

commands | while read -r name summary; do
    upper=$(printf 'mechkit-%s' "$name" | tr '[:lower:]' '[:upper:]')
    {
        printf '.Dd %s\n.Dt %s 1\n.Os "%s"\n' "$day" "$upper" "$version"
        printf '.Sh NAME\n.Nm mechkit-%s\n.Nd %s\n' "$name" "$(printf '%s' "$summary" | plain)"
        "$program" "$name" --help | plain | page
        printf '.Sh EXIT STATUS\n0 success, 1 the run or the check failed, 2 wrong usage, '
        printf '3 bad input file.\n.Sh SEE ALSO\n.Xr mechkit 1\n'
    } >"$out/mechkit-$name.1"
done

commands | while read -r name summary; do
    printf '.It Cm %s\n%s;\n.Xr mechkit-%s 1\n' "$name" "$(printf '%s' "$summary" | plain)" "$name"
done >"$out/commands"
sed -e "s/@DAY@/$day/" -e "s/@VERSION@/$version/" -e "/@COMMANDS@/{r $out/commands
d
}" "$here/man/mechkit.1.in" >"$out/mechkit.1"
rm "$out/commands"

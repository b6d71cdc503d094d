#!/bin/sh
# Makes the documentation as web pages: README, docs/*.md, the program's own help, and a gallery of
# plots that are made on the way. tools/html/build.sh PROGRAM DIRECTORY. Needs pandoc; fetches nothing.
set -eu
program=$(cd "$(dirname "$1")" && pwd)/$(basename "$1")
out=$2
tools=$(cd "$(dirname "$0")" && pwd)
here=$(cd "$tools/../.." && pwd)
command -v pandoc >/dev/null 2>&1 || {
    echo "html: pandoc is missing: apt-get install pandoc" >&2
    exit 1
}
rm -rf "$out"
mkdir -p "$out"
out=$(cd "$out" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Name and title of every page, in the order of the menu.
cat >"$work/pages" <<'LIST'
index Overview
gallery Gallery
commands Commands
console At the rig
boards Boards
safety Safety
faults Faults
protocol Protocol
design Gain design
identification Identification
explain What a model lacks
sweep Sweeps
theory Theory
effects Effects
formats Files
matlab MATLAB, Octave, FMI
adding Adding to it
LIST
for page in "$here"/docs/*.md; do # nothing is left out for want of a line above
    name=$(basename "$page" .md)
    grep -q "^$name " "$work/pages" || echo "$name $(sed -n '1s/^# *//p' "$page")" >>"$work/pages"
done
PAGES=$(cut -d' ' -f1 "$work/pages" | tr '\n' ' ')
export PAGES

# The help of every subcommand as one page.
commands() {
    echo "# Commands"
    echo
    "$program" --help | sed -n 's/^  \([a-z][a-z-]*\)  *\(.*\)$/\1 \2/p' |
        while read -r name summary; do
            printf '## mechkit %s\n\n%s\n\n' "$name" "$summary"
            "$program" "$name" --help | sed 's/^/    /'
            echo
        done
}

menu() { # NAME: the menu's metadata, with this page marked
    echo "page:"
    while read -r entry text; do
        printf -- '- name: "%s"\n  title: "%s"\n' "$entry" "$text"
        [ "$entry" != "$1" ] || echo '  here: true'
    done <"$work/pages"
}

"$tools/gallery.sh" "$program" "$work/gallery" >"$work/gallery.md"
mkdir -p "$out/gallery"
cp "$work"/gallery/*.svg "$out/gallery"
commands >"$work/commands.md"
cp -r "$here/docs/img" "$out"
cp "$tools/style.css" "$out"

while read -r name title; do
    case $name in
    index) source=$here/README.md ;;
    gallery | commands) source=$work/$name.md ;;
    *) source=$here/docs/$name.md ;;
    esac
    menu "$name" >"$work/menu.yaml"
    toc=--toc
    [ "$(grep -c '^## ' "$source")" -gt 2 ] || toc=""
    pandoc --from gfm --to html5 --no-highlight --template "$tools/template.html" \
        --lua-filter "$tools/links.lua" --metadata-file "$work/menu.yaml" $toc --toc-depth=2 \
        --metadata title="$title" --variable version="$(cat "$here/VERSION")" \
        --output "$out/$name.html" "$source"
done <"$work/pages"
echo "$(ls "$out"/*.html | wc -l) pages and $(ls "$out"/gallery/*.svg | wc -l) plots are in $out"

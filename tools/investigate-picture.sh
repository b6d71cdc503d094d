#!/bin/sh
# Draws docs/img/investigate.svg: what a model foresaw of a hidden rig before an investigation, and at its
# end, out of the notebook. usage: tools/investigate-picture.sh BUILD_DIR, which holds mechkit.
set -eu
build=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
{
    sed 's/^p1 = .*/p1 = 0.055/' models/furuta.ini
    printf '[effect.stribeck]\njoint = 2\nlevel = 0.05\nvelocity = 1\n'
    printf '[effect.cogging]\njoint = 1\namplitude = 0.1\ncycles = 7\nphase = 0.3\n'
} >"$work/rig.ini"
"$build/mechkit" investigate --model models/furuta.ini --rig "$work/rig.ini" --fast --out "$work/found"
# Of each experiment two joints and the command: the joints of the first and of the last.
grep '^<svg\|</dl>\|^<h2>Experiment' "$work/found/notebook.html" | awk '
    BEGIN { n = 0 }
    BEGIN { n = 0 }
    /^<h2>/ { shown = 0; experiment++; next }
    /^<svg/ && shown < 2 { shown++; sub(/<svg /, "<svg y=\"" (20 + 210 * n) "\" height=\"190\" width=\"680\" ")
        title[n] = "Experiment " experiment; picture[n++] = $0 }
    END {
        printf "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 680 %d\">", 20 + 210 * n
        print "<style>svg{font:11px sans-serif;fill:#5b6675}path{fill:none;stroke-width:1.4}"
        print ".a{stroke:#0b6bcb}.b{stroke:#d2571e;stroke-dasharray:4 3}.grid{stroke:#d5dbe3;stroke-width:.7}</style>"
        print "<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>"
        for (i = 0; i < n; i++) {
            printf "<text x=\"2\" y=\"%d\" font-weight=\"bold\">%s</text>\n", 16 + 210 * i, i % 2 ? "" : title[i]
            print picture[i]
        }
        print "</svg>"
    }' >"$work/investigate.svg"
cp "$work/investigate.svg" docs/img/investigate.svg
echo "docs/img/investigate.svg written"

#!/bin/sh
# The main job on the virtual board: every setup from its command file, one in real time, a prediction,
# a rig that its model does not know, explained, plots, and a page of it all. Usage: tools/demo.sh DIRECTORY [PROGRAM]. DIRECTORY must be new or empty; PROGRAM: mechkit on the
# path. Installed, it is share/mechkit/tools/demo.sh.
set -eu

out=$1
program=${2:-mechkit}
here=$(dirname "$0")/..

mkdir -p "$out"
if [ -n "$(ls -A "$out")" ]; then
    echo "demo: $out is not empty" >&2
    exit 2
fi

run() { # NAME OPTIONS...: runs scripts/NAME.cmd; a failure ends the demo
    name=$1
    shift
    if ! "$program" run "$here/scripts/$name.cmd" --out "$out" --quiet "$@"; then
        echo "demo: setup $name failed, see above" >&2
        exit 1
    fi
}

echo "mechkit demo: the kit's setups on the virtual board"
echo
for setup in pendubot-mid pendubot-top reaction-wheel furuta pi-speed open-loop; do
    run "$setup" --fast
    "$program" summary "$out/$setup.csv" | sed 's/^/  /' | tee "$out/$setup.txt"
done
echo
echo "the pendubot once more, in real time:"
# A machine that stalls for more than the watchdog's 20 ms gets its motor switched off, as it should;
# that is the machine's fault, not the demo's: three tries, then a note.
for try in 1 2 3; do
    if "$program" run "$here/scripts/realtime.cmd" --out "$out" --quiet 2>"$out/realtime.txt"; then
        break
    fi
done
if [ -f "$out/realtime.csv" ]; then
    rm -f "$out/realtime.txt"
    "$program" summary "$out/realtime.csv" | sed 's/^/  /' | tee "$out/realtime.txt"
elif grep -Eq 'fault (watchdog|overrun)' "$out/realtime.txt"; then
    sed 's/^/  /' "$out/realtime.txt"
    echo "  this machine is too busy for real time just now"
else
    cat "$out/realtime.txt" >&2
    exit 1
fi
[ -f "$out/realtime.csv" ] || rm -f "$out/realtime.txt"

cp "$here/models/pendubot.ini" "$out/pendubot.ini"
echo
echo "the model against the log it made, started from the encoders' readings:"
"$program" simulate --model "$out/pendubot.ini" --input "$out/open-loop.csv" \
    --out "$out/open-loop-predicted.csv" --json "$out/open-loop-predicted.json" | sed 's/^/  /' |
    tee -a "$out/open-loop.txt"

# A bearing that sticks, on the rig alone: its model does not know.
{ cat "$here/models/furuta.ini" &&
    printf '\n[effect.stribeck]\njoint = 2\nlevel = 0.05\nvelocity = 1\n'; } >"$out/sticky.ini"
swing() { # NAME SIGNAL
    printf 'setup open-loop\ninput %s\nstart\nwait 10\nhalt\nsave %s.csv\n' "$2" "$1" >"$out/$1.cmd"
    "$program" run "$out/$1.cmd" --model "$out/sticky.ini" --fast --out "$out" --quiet
}
echo
echo "a Furuta pendulum whose bearing sticks, which its model does not know, explained:"
swing learn '2.5*sin(6*t)+1.5*sin(9.3*t)'
swing check '3*chirp(0.3,2,10)'
"$program" explain --model "$here/models/furuta.ini" --out "$out/explain" --holdout "$out/check.csv" \
    "$out/learn.csv" >"$out/explain.txt"
head -n 7 "$out/explain.txt" | sed 's/^/  /'

plots=0
if command -v gnuplot >/dev/null 2>&1; then
    for log in pendubot-mid pendubot-top reaction-wheel furuta pi-speed realtime; do
        [ -f "$out/$log.csv" ] || continue
        "$program" plot "$out/$log.csv" --out "$out/$log.svg"
        "$program" plot "$out/$log.csv" --out "$out/$log.png"
        plots=$((plots + 2))
    done
    "$program" plot "$out/open-loop.csv" --with "$out/open-loop-predicted.csv" \
        --out "$out/open-loop.svg"
    "$program" plot "$out/open-loop.csv" --with "$out/open-loop-predicted.csv" \
        --out "$out/open-loop.png"
    plots=$((plots + 2))
else
    echo "  no plots: gnuplot is not installed"
fi

echo
echo "$(find "$out" -name '*.csv' | wc -l) logs, $plots plots (SVG and PNG) and the model are in $out"

# --- the page ---------------------------------------------------------------------------------------

escaped() { sed 's/&/\&amp;/g; s/</\&lt;/g; s/>/\&gt;/g; s/"/\&quot;/g' "$1"; }

section() { # NAME: what a run was, its figures, its plot
    [ -f "$out/$1.csv" ] || return 0
    printf '<h2>%s</h2><pre>' "$1"
    escaped "$out/$1.txt"
    printf '</pre>'
    [ -f "$out/$1.svg" ] || return 0
    printf '<img alt="plot of %s" src="data:image/svg+xml;base64,%s">' "$1" \
        "$(base64 <"$out/$1.svg" | tr -d '\n')"
}

{
    printf '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>mechkit demo</title><style>'
    printf 'body{font-family:sans-serif;max-width:1100px;margin:2em auto;padding:0 1em}'
    printf 'pre{overflow-x:auto;background:#f4f4f4;padding:.6em}img{width:100%%}'
    printf 'iframe{width:100%%;height:60em;border:1px solid #ccc}</style></head><body>'
    printf '<h1>mechkit demo</h1><p>What was run on the virtual board; logs and plots are beside this page.</p>'
    for name in pendubot-mid pendubot-top reaction-wheel furuta pi-speed realtime open-loop; do
        section "$name"
    done
    printf '<h2>A Furuta pendulum whose bearing sticks, explained</h2><pre>'
    escaped "$out/explain.txt"
    printf '</pre><iframe title="report of explain" srcdoc="'
    escaped "$out/explain/report.html"
    printf '"></iframe></body></html>\n'
} >"$out/index.html"
for name in pendubot-mid pendubot-top reaction-wheel furuta pi-speed realtime open-loop explain; do
    rm -f "$out/$name.txt"
done
echo "all of it on a page: $out/index.html"

#!/bin/sh
# The main job on the virtual board: every setup from its command file, one in real time, a prediction,
# plots. Usage: tools/demo.sh DIRECTORY [PROGRAM]. DIRECTORY must be new or empty; PROGRAM: mechkit on the
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
    printf '  '
    "$program" summary "$out/$setup.csv"
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
    printf '  '
    "$program" summary "$out/realtime.csv"
elif grep -Eq 'fault (watchdog|overrun)' "$out/realtime.txt"; then
    sed 's/^/  /' "$out/realtime.txt"
    echo "  this machine is too busy for real time just now"
else
    cat "$out/realtime.txt" >&2
    exit 1
fi
rm -f "$out/realtime.txt"

cp "$here/models/pendubot.ini" "$out/pendubot.ini"
echo
echo "the model against the log it made, started from the encoders' readings:"
"$program" simulate --model "$out/pendubot.ini" --input "$out/open-loop.csv" \
    --out "$out/open-loop-predicted.csv" --json "$out/open-loop-predicted.json" | sed 's/^/  /'

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

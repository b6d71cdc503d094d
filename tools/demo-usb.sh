#!/bin/sh
# A swing-up on an emulated board, in real time, through libusb and through ppdev, with logs and plots.
# Usage: tools/demo-usb.sh PROGRAM DIRECTORY
set -eu
program=$1
out=$2
here=$(dirname "$0")/..

rm -rf "$out"
mkdir -p "$out"
"$program" boards
for board in usb parport; do
    echo
    echo "a pendubot on an emulated board, by $board:"
    # A machine that stalls for longer than the watchdog's 20 ms gets its motor switched off, as it should.
    for try in 1 2 3; do
        if "$program" run "$here/scripts/usb.cmd" --board $board --out "$out/$board" --quiet \
            2>"$out/trouble.txt"; then
            break
        fi
        [ "$try" -lt 3 ] || { cat "$out/trouble.txt" >&2; exit 1; }
    done
    printf '  '
    "$program" summary "$out/$board/usb.csv"
    if command -v gnuplot >/dev/null 2>&1; then
        "$program" plot "$out/$board/usb.csv" --out "$out/$board/usb.svg"
        echo "  log and plot are in $out/$board"
    fi
done
rm -f "$out/trouble.txt"

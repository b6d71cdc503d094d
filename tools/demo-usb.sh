#!/bin/sh
# A swing-up through libusb on an emulated board, in real time, with log and plot.
# Usage: tools/demo-usb.sh PROGRAM DIRECTORY
set -eu
program=$1
out=$2
here=$(dirname "$0")/..

rm -rf "$out"
mkdir -p "$out"
echo "mechkit through libusb to an emulated board, a pendubot on it:"
# A machine that stalls for longer than the watchdog's 20 ms gets its motor switched off, as it should.
for try in 1 2 3; do
    if "$program" run "$here/scripts/usb.cmd" --board usb --out "$out" --quiet 2>"$out/trouble.txt"; then
        break
    fi
    [ "$try" -lt 3 ] || { cat "$out/trouble.txt" >&2; exit 1; }
done
rm -f "$out/trouble.txt"
printf '  '
"$program" summary "$out/usb.csv"
if command -v gnuplot >/dev/null 2>&1; then
    "$program" plot "$out/usb.csv" --out "$out/usb.svg"
    echo "  log and plot are in $out"
fi

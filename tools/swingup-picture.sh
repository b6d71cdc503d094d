#!/bin/sh
# Draws docs/img/swingup-trajectory.png and swingup-beside.png: the shortest swing-up of the pendubot, and it
# beside the swing-up by energy on the virtual board. usage: tools/swingup-picture.sh BUILD_DIR, which holds mechkit.
set -eu
mechkit=$1/mechkit
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
for name in pendubot-mid pendubot-mid-fast; do
    sed -e 's/^expect balanced for .*/wait 2.5/' -e "s|\.\./models|$PWD/models|" "scripts/$name.cmd" >"$work/$name.cmd"
    "$mechkit" run "$work/$name.cmd" --fast --quiet --out "$work"
done
"$mechkit" plot models/pendubot-mid-swingup.csv --title "Pendubot: swing-up to be followed" \
    --out docs/img/swingup-trajectory.png
"$mechkit" plot "$work/pendubot-mid-fast.csv" "$work/pendubot-mid.csv" \
    --title "Pendubot: along a trajectory, and by energy" --out docs/img/swingup-beside.png

#!/bin/sh
# Renders docs/img/explain.png: a report on a made-up rig with friction that the model does not know.
# usage: tools/explain-picture.sh BUILD_DIR
# BUILD_DIR holds mechkit and mechkit-challenge. Needs chromium; without it this says so.
set -eu
build=$1
browser=$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)
if [ -z "$browser" ]; then
    echo "no browser to render the report with: docs/img/explain.png stays as it is"
    exit 0
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$build/mechkit-challenge" --effect stribeck --joint 2 --rig furuta --kind single --cases 1 --seed 7 \
    --write "$work"
"$build/mechkit" explain --model "$work/case_7/base.ini" --out "$work/report" \
    --holdout "$work/case_7/holdout_1.csv.gz" "$work"/case_7/train_*.csv.gz
"$browser" --headless --no-sandbox --disable-gpu --hide-scrollbars --window-size=760,1270 \
    --screenshot="$work/explain.png" "file://$work/report/report.html" >"$work/log" 2>&1 ||
    { cat "$work/log" >&2; exit 1; }
cp "$work/explain.png" docs/img/explain.png
echo "docs/img/explain.png written"

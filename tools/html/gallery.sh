#!/bin/sh
# Runs the commands of the gallery and writes it as Markdown: tools/html/gallery.sh PROGRAM DIRECTORY.
# Pictures and logs go to DIRECTORY; what is shown of a command is what was run.
set -eu
program=$1
out=$2
here=$(cd "$(dirname "$0")/../.." && pwd)
mkdir -p "$out"
cd "$out"
cp "$here"/scripts/*.cmd "$here/models/pendubot.ini" .
sed -i 's|^model \.\./models/|model models/|' ./*.cmd
mkdir -p models
cp "$here"/models/*.ini models

mechkit() { "$program" "$@" >>commands.log 2>&1; }

# picture FILE CAPTION, commands on standard input
picture() {
    commands=$(cat)
    if ! eval "$commands"; then
        cat commands.log >&2
        echo "gallery: failed: $commands" >&2
        exit 1
    fi
    cat <<MD
<figure><img src="gallery/$1" alt="$2"><figcaption>$2</figcaption></figure>

$(printf '%s\n' "$commands" | sed 's/^/    /')

MD
}

cat <<'MD'
# Gallery

Every picture here was made while these pages were built, by the commands under it, on the virtual board.

## Swinging up and balancing

MD

picture pendubot-mid.svg "Pendubot: two swings, caught (dotted line), held" <<'SH'
mechkit run pendubot-mid.cmd --fast --quiet --out runs
mechkit plot runs/pendubot-mid.csv --out pendubot-mid.svg
SH

picture furuta.svg "Furuta pendulum: the arm pumps the pendulum up and catches it" <<'SH'
mechkit run furuta.cmd --fast --quiet --out runs
mechkit plot runs/furuta.csv --out furuta.svg
SH

picture reaction-wheel.svg "Reaction-wheel pendulum: swung up and held; the wheel slows down again" <<'SH'
mechkit run reaction-wheel.cmd --fast --quiet --out runs
mechkit plot runs/reaction-wheel.csv --out reaction-wheel.svg
SH

picture pi-speed.svg "Inertia wheel: steps and ramps of the speed" <<'SH'
mechkit run pi-speed.cmd --fast --quiet --out runs
mechkit plot runs/pi-speed.csv --out pi-speed.svg
SH

cat <<'MD'
## Several runs over each other

MD

cat >sticky.ini <<'INI'
[rig]
kind = pendubot

[parameters]
p1 = 0.0540
p2 = 0.0540
p3 = 0.0286
p4 = 0.7805
p5 = 0.3284
p6 = 0.1346
p7 = 0.2014

[effect.stiction]
joint = 1
stiffness = 30
damping = 0.05
level = 0.25
INI

picture friction.svg "The textbook pendubot, and one whose motor joint sticks" <<'SH'
mechkit run open-loop.cmd --fast --quiet --out textbook
mechkit run open-loop.cmd --model sticky.ini --fast --quiet --out sticky
cp textbook/open-loop.csv textbook.csv; cp sticky/open-loop.csv sticky.csv
mechkit plot textbook.csv sticky.csv --title "1.5 sin 6t, without and with stiction" --out friction.svg
SH

cat <<'MD'
## Measured against simulated

MD

picture lacking.svg "The textbook model driven by the command of the sticking rig: what it lacks" <<'SH'
mechkit simulate --model pendubot.ini --input sticky.csv --out predicted.csv --window 2
mechkit plot sticky.csv --with predicted.csv --title "sticking rig, textbook model" --out lacking.svg
SH

picture with-stiction.svg "The same log, the model with stiction: what is left is the steps of the encoder" <<'SH'
mechkit simulate --model sticky.ini --input sticky.csv --out predicted-sticky.csv --window 2
mechkit plot sticky.csv --with predicted-sticky.csv --title "with stiction" --out with-stiction.svg
SH

cat <<'MD'
## Spectra and responses

MD

cat >chirp.cmd <<'CMD'
model models/pendubot.ini
setup open-loop
input 1.2*chirp(0.3, 12, 60)
start
wait 60
halt
save chirp.csv
CMD

picture response.svg "Spectra of a chirp and of the angles of a hanging pendubot, and the response between them" <<'SH'
mechkit run chirp.cmd --fast --quiet --out runs
mechkit plot runs/chirp.csv --spectrum --out response.svg
SH

cat <<'MD'
## Phase planes

MD

picture phase.svg "Phase planes of the pendubot on its way up" <<'SH'
mechkit plot runs/pendubot-mid.csv --phase --out phase.svg
SH

cat <<'MD'
## Without a screen

    mechkit plot textbook.csv --size 90x12

MD
echo '```'
"$program" plot textbook.csv --size 90x12 | sed 's/\x1b\[[0-9;]*m//g'
echo '```'

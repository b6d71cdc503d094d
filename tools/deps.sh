#!/bin/sh
# Installs the packages that mechkit needs and that are missing. On Debian and Ubuntu with apt-get
# (and sudo when not root, saying so first); elsewhere it names them and fails.
set -eu

packages="gcc g++ make pkg-config libsundials-dev libeigen3-dev libcjson-dev libinih-dev
zlib1g-dev libusb-1.0-0-dev libncurses-dev libmatio-dev check gnuplot-nox"

missing=""
if command -v dpkg-query >/dev/null 2>&1; then
    for p in $packages; do
        dpkg-query -W -f='${Status}' "$p" 2>/dev/null | grep -q 'install ok installed' ||
            missing="$missing $p"
    done
    # gnuplot comes in flavours; any of them draws.
    if command -v gnuplot >/dev/null 2>&1; then
        missing=$(printf '%s' "$missing" | sed 's/ gnuplot-nox//')
    fi
    [ -n "$missing" ] || exit 0
else
    for h in sundials/sundials_config.h cjson/cJSON.h ini.h zlib.h libusb-1.0/libusb.h curses.h matio.h check.h; do
        printf '#include <%s>\n' "$h" | ${CC:-cc} -E - >/dev/null 2>&1 || missing="$missing $h"
    done
    [ -n "$missing" ] || exit 0
    cat >&2 <<TXT
mechkit: these headers are missing:$missing
Install the development packages of: SUNDIALS (6.4 or later), Eigen 3, cJSON, inih, zlib, libusb 1.0,
ncurses, matio, check, gnuplot, pkg-config, a C11 and C++17 compiler. Their usual names:
  Fedora:  sundials-devel eigen3-devel cjson-devel inih-devel zlib-devel libusb1-devel ncurses-devel matio-devel check-devel gnuplot
  Arch:    sundials eigen cjson libinih zlib libusb ncurses libmatio check gnuplot pkgconf
  openSUSE: sundials-devel eigen3-devel cJSON-devel inih-devel zlib-devel libusb-1_0-devel ncurses-devel matio-devel check-devel gnuplot
TXT
    exit 1
fi

as_root=""
if [ "$(id -u)" != 0 ]; then
    if ! command -v sudo >/dev/null 2>&1; then
        echo "mechkit: missing packages:$missing" >&2
        echo "mechkit: run as root: apt-get install$missing" >&2
        exit 1
    fi
    as_root=sudo
fi
echo "mechkit: installing missing packages:$missing" >&2
echo "mechkit: running '${as_root:+$as_root }apt-get install'" >&2
export DEBIAN_FRONTEND=noninteractive
# shellcheck disable=SC2086
$as_root apt-get install -y -qq --no-install-recommends $missing >/dev/null 2>&1 || {
    $as_root apt-get update -qq
    $as_root apt-get install -y -qq --no-install-recommends $missing
}

#!/bin/sh
# Runs the Check suites of one build variant. Sanitizers get their settings here, so that a developer
# and CI see the same.
set -eu
tests=$1
variant=$2
export CK_TIMEOUT_MULTIPLIER=1
# A failure's message quotes what a command printed; Check ends the test where it is longer than this.
export CK_MAX_MSG_SIZE=65536
# What runs the same code many times over, for the figures, runs once: without a sanitizer.
threaded="ring clock log_writer console console_pty tui safety rig loop loop_faults board standalone \
    doctor usb parport ppdev streams serve boards_cli bus_runs replug bus_faults fault_script robustness \
    hidden sweep"
# What goes by the clock waits most of the time. What computes runs beside it, behind it.
by_clock="clock log_writer console console_pty tui safety rig loop loop_faults board standalone doctor usb \
    parport ppdev streams serve boards_cli bus_runs replug bus_faults fault_script"
# What takes more than a minute by itself has its turn with `make check-all` only.
patient=${MK_CHECK_ALL:+none}
export CK_EXCLUDE_TAGS=${patient:-patient}
suites=""
beside=""
case $variant in
release) suites=$by_clock beside=yes ;;
asan)
    export CK_EXCLUDE_TAGS="$CK_EXCLUDE_TAGS long"
    export ASAN_OPTIONS=detect_leaks=1:abort_on_error=0 UBSAN_OPTIONS=print_stacktrace=1
    export CK_TIMEOUT_MULTIPLIER=6 ;;
tsan)
    export CK_EXCLUDE_TAGS="$CK_EXCLUDE_TAGS long one-thread"
    suites=$threaded
    export TSAN_OPTIONS=halt_on_error=1
    export CK_TIMEOUT_MULTIPLIER=12 ;;
esac
# What was skipped is said again at the end, where it is seen.
notes=$(mktemp)
trap 'rm -f "$notes" "$notes.code" "$notes.beside"; [ -z "$pid" ] || kill "$pid" 2>/dev/null || true' EXIT
trap 'exit 130' INT TERM
pid=""
if [ -n "$beside" ]; then
    echo "The suites that compute run beside those that go by the clock; what they print comes after."
    # shellcheck disable=SC2086 # suites are words
    nice -n 10 "$tests" --but $suites >"$notes.beside" 2>&1 &
    pid=$!
fi
# shellcheck disable=SC2086 # suites are words
{ { "$tests" $suites 3>&- || echo $? >"$notes.code"; } 2>&1 >&3 | tee "$notes" >&2; } 3>&1
if [ -n "$beside" ]; then
    echo "Those that compute are still at it ..."
    wait "$pid" || echo $? >"$notes.code"
    cat "$notes.beside"
    cat "$notes.beside" >>"$notes"
fi
skipped=$(grep -c skipped "$notes" || true)
echo "$skipped skipped$([ "$skipped" = 0 ] || echo ':')"
grep skipped "$notes" | sed 's/^/  /' || true
[ ! -s "$notes.code" ] || exit "$(cat "$notes.code")"

#!/bin/sh
# Runs the Check suites of one build variant, each in a process of its own, two at a time. Sanitizers get
# their settings here, so that a developer and CI see the same.
# shellcheck disable=SC2046,SC2086 # suites and lanes are words
set -eu
tests=$1
variant=$2
export CK_TIMEOUT_MULTIPLIER=1
# A failure's message quotes what a command printed; Check ends the test where it is longer than this.
export CK_MAX_MSG_SIZE=65536
# What runs the same code many times over, for the figures, runs once: without a sanitizer.
threaded="ring clock log_writer console console_pty tui safety rig loop loop_log loop_params loop_samples \
    loop_faults loop_lies loop_start loop_thread board standalone doctor usb parport ppdev streams \
    stream_troubles tcp serial serve boards_cli bus_runs replug bus_faults fault_script robustness hidden sweep"
# What goes by the clock waits most of the time. One suite at a time of these runs, and one that computes
# beside it, behind it. One of these that fails there is run once more at the end, with the machine to
# itself: what fails then is the program's fault and not the machine's.
by_clock="clock log_writer console console_pty tui safety rig loop loop_log loop_params loop_samples \
    loop_faults loop_lies loop_start loop_thread board standalone doctor usb parport ppdev streams \
    stream_troubles tcp serial serve boards_cli bus_runs replug bus_faults fault_script"
# What takes longest comes first, so that the two end together.
heavy="inputs misfit own_values hidden linear foreign explain data_check investigate ratios contact slides \
    compensate trajectory residual excite robustness"
# Tags of test cases: "long" is not run under sanitizers, "threads" only where threads are looked at, and
# "one-thread" not there.
# What takes half a minute or more by itself has its turn with `make check-all` only.
patient=${MK_CHECK_ALL:+none}
export CK_EXCLUDE_TAGS=${patient:-patient}
chosen=""
case $variant in
asan)
    export CK_EXCLUDE_TAGS="$CK_EXCLUDE_TAGS long threads"
    export ASAN_OPTIONS=detect_leaks=1:abort_on_error=0 UBSAN_OPTIONS=print_stacktrace=1
    export CK_TIMEOUT_MULTIPLIER=6 ;;
tsan)
    export CK_EXCLUDE_TAGS="$CK_EXCLUDE_TAGS long one-thread"
    chosen=$threaded
    export TSAN_OPTIONS=halt_on_error=1
    export CK_TIMEOUT_MULTIPLIER=12 ;;
esac
# A suite by itself says what it does as it goes. Tests of this script start it anew, with suites of theirs.
if [ -n "${CK_RUN_SUITE:-}" ]; then
    one=$CK_RUN_SUITE
    unset CK_RUN_SUITE
    exec "$tests" "$one"
fi

all=$("$tests" --list)
# Words of $1 that are, or with "but" are not, among those of $2.
among() {
    for word in $1; do
        case " $(echo $2) " in
        *" $word "*) [ "${3:-}" = but ] || printf '%s ' "$word" ;;
        *) [ "${3:-}" != but ] || printf '%s ' "$word" ;;
        esac
    done
}
chosen=$(among "$all" "${chosen:-$all}")
waiting=$(among "$by_clock" "$chosen")
computing=$(among "$heavy" "$chosen")
computing="$computing$(among "$chosen" "$by_clock $heavy" but)"

work=$(mktemp -d)
said=$work/said
mkfifo "$said"
# Opened for both, it never ends: each lane says when it is done.
exec 3<>"$said"
lanes=""
child=""
trap '[ -z "$lanes" ] || { kill $lanes $child; wait $lanes $child; } 2>/dev/null || true; rm -rf "$work"' EXIT
trap 'exit 130' INT TERM HUP

# Runs a suite; its exit code is in $code.
run_suite() {
    # Check writes one file, and there are as many as suites.
    [ -z "${CK_XML_LOG_FILE_NAME:-}" ] ||
        export CK_XML_LOG_FILE_NAME="${xml:=${CK_XML_LOG_FILE_NAME%.xml}}.$1.xml"
    behind=""
    [ -z "$(among "$1" "$computing")" ] || behind="nice -n 10"
    code=0
    $behind "$tests" "$1" >"$work/$1/out" 2>&1 3>&- &
    child=$!
    wait "$child" || code=$?
}

# Takes one suite after the other that the other lane has not taken: making its directory is taking it.
lane() {
    number=$1
    shift
    child=""
    trap - EXIT
    trap '{ kill "$child"; wait "$child"; } 2>/dev/null; exit 130' INT TERM HUP
    for suite in "$@"; do
        mkdir "$work/$suite" 2>/dev/null || continue
        echo "starts $number $suite" >&3
        begun=$(date +%s)
        run_suite "$suite"
        echo "ends $number $suite $code $(($(date +%s) - begun))" >&3
    done
    echo "done $number" >&3
}
lane 1 $waiting $computing &
lanes=$!
lane 2 $computing &
lanes="$lanes $!"
while sleep 30 >/dev/null 2>&1 3>&-; do echo tick >&3; done >/dev/null 2>&1 &
lanes="$lanes $!"

# What a suite prints comes in one piece when it is done.
at_1="" at_2="" busy=2 result=0 failed=""
while [ "$busy" != 0 ] && read -r what number suite code seconds <&3; do
    case $what in
    starts) eval "at_$number=\$suite" ;;
    ends)
        cat "$work/$suite/out"
        echo "$seconds $suite" >>"$work/times"
        [ "$code" = 0 ] || failed="$failed $suite:$code"
        eval "at_$number=" ;;
    done) busy=$((busy - 1)) ;;
    tick) echo "... at $at_1${at_1:+${at_2:+ and }}$at_2, $(wc -l <"$work/times" 2>/dev/null || echo 0)" \
        "of $(echo $chosen | wc -w) suites are done" ;;
    esac
done
beside_others=$failed failed=""
for one in $beside_others; do
    suite=${one%:*} code=${one#*:}
    if [ -n "$(among "$suite" "$by_clock")" ]; then
        # What the first try said stays said, and counts no more.
        sed -n '/:[FE]:/s/^/  /p' "$work/$suite/out"
        echo "... $suite failed beside other suites: once more by itself"
        run_suite "$suite"
        cat "$work/$suite/out"
    fi
    [ "$code" = 0 ] || failed="$failed $suite" result=$code
done
cat "$work"/*/out >"$work/all"
sed -n 's/^[0-9]*%: Checks: \([0-9]*\), Failures: \([0-9]*\), Errors: \([0-9]*\)$/\1 \2 \3/p' "$work/all" |
    awk '{c += $1; f += $2; e += $3} END {printf "%d checks, %d failures, %d errors\n", c, f, e}'
echo "longest:$(sort -rn "$work/times" | head -n 5 | awk '{printf "%s %s %d s", s, $2, $1; s = ","}')"
# A failure is said again at the end, where it is seen.
[ -z "$failed" ] || echo "failed:$failed"
grep ':[FE]:' "$work/all" | sed 's/^/  /' || true
# What was skipped is said again at the end, where it is seen.
skipped=$(grep -c skipped "$work/all" || true)
echo "$skipped skipped$([ "$skipped" = 0 ] || echo ':')"
grep skipped "$work/all" | sed 's/^/  /' || true
exit "$result"

#!/bin/sh
# Runs the Check suites of one build variant. Sanitizers get their settings here, so that a developer
# and CI see the same.
set -eu
tests=$1
variant=$2
export CK_TIMEOUT_MULTIPLIER=1
# A failure's message quotes what a command printed; Check ends the test where it is longer than this.
export CK_MAX_MSG_SIZE=65536
case $variant in
asan)
    export ASAN_OPTIONS=detect_leaks=1:abort_on_error=0 UBSAN_OPTIONS=print_stacktrace=1
    export CK_TIMEOUT_MULTIPLIER=6 ;;
tsan)
    export TSAN_OPTIONS=halt_on_error=1
    export CK_TIMEOUT_MULTIPLIER=12 ;;
esac
exec "$tests"

#!/bin/sh
# Every kind of fault at every request of a short run, over each bus, and the sums.
# Usage: tools/fault-campaign.sh TESTS
set -eu
log=$(mktemp)
trap 'rm -f "$log"' EXIT
status=0
MECHKIT_CAMPAIGN=all CK_TIMEOUT_MULTIPLIER=10 "$1" bus_faults >"$log" || status=$?
awk '{ print }
    / x[0-9]+: injected/ {
        gsub(/,|;/, "")
        for (i = 1; i < NF; i++) {
            if ($i == "injected") injected += $(i + 1)
            if ($i == "survived") survived += $(i + 1)
            if ($i == "off") off += $(i + 1)
        }
    }
    END { printf "faults injected %d, survived %d, motor off proven %d\n", injected, survived, off }' "$log"
# What a person at the rig would see: a cable pulled in mid run, the program killed in mid swing-up.
MECHKIT_CAMPAIGN=all "$1" replug | grep -v '^Running' || status=1
exit "$status"

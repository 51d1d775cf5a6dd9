#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What is said of a contender's arrivals: gaps count to the end, and who never returns is not the best.
set -euo pipefail
# shellcheck source=evaluation/real/summary.sh
. "$(dirname "${BASH_SOURCE[0]}")/../../../evaluation/real/summary.sh"
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-summary.XXXXXX")
trap 'rm -rf "$work"' EXIT

expect() { # WANTED GOT
  [ "$1" = "$2" ] || { printf 'expected:\n%s\ngot:\n%s\n' "$1" "$2" >&2 && exit 1; }
}

printf '000000 10.0\n000004 10.3\n000005 12.5\n000006 12.1\n' >"$work/arrivals"
expect 3 "$(longest_gap "$work/arrivals" 7)"
expect 3 "$(longest_gap "$work/arrivals" 10)"
expect 13 "$(longest_gap "$work/arrivals" 20)"
expect 20 "$(longest_gap /dev/null 20)"

: >"$work/outages"
expect '- -' "$(returns "$work/outages" "$work/arrivals")"
echo '10.1 10.2' >>"$work/outages"
expect '0.100 0.100' "$(returns "$work/outages" "$work/arrivals")"
echo '11.0 12.0' >>"$work/outages"
expect '0.100 0.100' "$(returns "$work/outages" "$work/arrivals")"
echo '13.0 14.0' >>"$work/outages"
expect '0.100 never' "$(returns "$work/outages" "$work/arrivals")"
printf '15.0 16.0\n17.0 18.0\n' >>"$work/outages"
expect 'never never' "$(returns "$work/outages" "$work/arrivals")"

# Frames 4 and 5 are on time, 6 and 7 are late, 34 is on time again: 0.16 s behind the earliest.
printf '000004 10.0\n000005 10.04\n000006 11.3\n000007 11.32\n000034 11.36\n000040 11.5\n' >"$work/late"
echo '10.1 11.0' >"$work/outages"
expect '0.300 0.300' "$(returns "$work/outages" "$work/late")"
expect '0.360 0.360' "$(live_again "$work/outages" "$work/late" 25)"
echo '12.0 13.0' >>"$work/outages"
expect '0.360 never' "$(live_again "$work/outages" "$work/late" 25)"

expect '| a | 13 | 0.10, never | 0.20, 0.30 | 0.50 | 2 | 4 |' \
  "$(summary_row a <<<'13 0.100 never 0.2 0.3 0.500 2048 4')"
expect '| a | 13 | -, - | -, - | 0.50 | 2 | 4 |' "$(summary_row a <<<'13 - - - - 0.500 2048 4')"
expect 'RESULT paper.peer.a.longest_gap 13
RESULT paper.peer.a.return_s inf
RESULT paper.peer.a.live_again_s inf
RESULT paper.peer.a.cpu_ms_per_frame 0.500' "$(summary_results a <<<'13 never never never never 0.500 2048 4')"
expect 'RESULT paper.peer.a.longest_gap 13
RESULT paper.peer.a.cpu_ms_per_frame 0.500' "$(summary_results a <<<'13 - - - - 0.500 2048 4')"
expect 'RESULT paper.peer.a.longest_gap 13
RESULT paper.peer.a.return_s 0.100
RESULT paper.peer.a.live_again_s 0.900
RESULT paper.peer.a.cpu_ms_per_frame 0.500' "$(summary_results a <<<'13 0.100 never 0.900 never 0.500 2048 4')"

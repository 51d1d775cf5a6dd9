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

expect '| a | 13 | 0.10, never | 0.50 | 2 | 4 |' "$(summary_row a <<<'13 0.100 never 0.500 2048 4')"
expect '| a | 13 | -, - | 0.50 | 2 | 4 |' "$(summary_row a <<<'13 - - 0.500 2048 4')"
expect 'RESULT paper.peer.a.longest_gap 13
RESULT paper.peer.a.return_s inf
RESULT paper.peer.a.cpu_ms_per_frame 0.500' "$(summary_results a <<<'13 never never 0.500 2048 4')"
expect 'RESULT paper.peer.a.longest_gap 13
RESULT paper.peer.a.cpu_ms_per_frame 0.500' "$(summary_results a <<<'13 - - 0.500 2048 4')"
expect 'RESULT paper.peer.a.longest_gap 13
RESULT paper.peer.a.return_s 0.100
RESULT paper.peer.a.cpu_ms_per_frame 0.500' "$(summary_results a <<<'13 0.100 never 0.500 2048 4')"

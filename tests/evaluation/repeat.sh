#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The same seed gives the same world, and the same results on simulated links, to the byte.
# Usage: repeat.sh FOLDER_OF_PROGRAMS
set -euo pipefail
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-repeat.XXXXXX")
trap 'rm -rf "$work"' EXIT
seq 0 20 4000 >"$work/link.up"
for run in one other; do
  "$1/orbbuf-world" "$work/$run/world" --seed 3 --frames 160
  "$1/orbbuf-trial" "$work/$run/world" --seed 3 --out "$work/$run/results" --run interruption \
    --run traces --places 1 --outages 1 --repeats 1 --traces "$work/link.up" \
    >"$work/$run/said"
  grep -q '^RESULT paper.interruption.orbbuf.survived_share' "$work/$run/said"
  grep -q '^RESULT paper.4g.link.orbbuf.ate_ratio' "$work/$run/said"
done
diff -r "$work/one" "$work/other"

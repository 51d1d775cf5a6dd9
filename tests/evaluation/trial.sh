#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# orbbuf-trial on a world of 5 s: of real sessions, one that has all is as good as unbroken, one that ends halfway
# is lost, and one that is never back from an outage has a gap to the end; what needs a longer world says so.
# Usage: trial.sh FOLDER_OF_PROGRAMS
set -euo pipefail
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-trial.XXXXXX")
trap 'rm -rf "$work"' EXIT
"$1/orbbuf-world" "$work/world" --seed 3 --frames 130
mkdir "$work/half"
head -n 65 "$work/world/times.txt" >"$work/half/times.txt"
"$1/orbbuf-trial" "$work/world" --out "$work" --run paths --session "all@run=$work/world" \
  "half@run=$work/half" >"$work/said"
grep -q '^RESULT paper.real4g.run.all.ate_ratio 1.000$' "$work/said"
grep -q '^RESULT paper.real4g.run.half.ate_ratio inf$' "$work/said"
grep -q '^| run | half | 65 of 130 | 65 | lost |$' "$work/paths.md"

echo 'half@run 50 100' >"$work/outages"
"$1/orbbuf-trial" "$work/world" --out "$work" --run sessions --outage-list "$work/outages" \
  --result paper.real --session "half@run=$work/half" >"$work/said"
grep -q '^RESULT paper.real.half.survived_share.2 0.0000$' "$work/said"
grep -q '^| half | 2 s | 0 of 1: .* | 65 |$' "$work/sessions.md"

refuses() { # PROGRAMS EXPERIMENT WORDS
  "$1/orbbuf-trial" "$work/world" --out "$work" --run "$2" >/dev/null 2>"$work/why" && return 1
  grep -q "$3" "$work/why"
}
refuses "$1" tolerance 'needs more than 135 frames'
refuses "$1" buffer 'needs more than 7 s'

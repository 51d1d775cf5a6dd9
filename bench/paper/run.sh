#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The paper's evaluation (sec. III-F and IV): renders a world, lets contenders send it over real TCP
# and over simulated links, and judges what arrived.
# Usage: bench/paper/run.sh BUILD_FOLDER OUT_FOLDER [--full] [--seed N] [--traces FOLDER]
# OUT_FOLDER gets CSV, tables (Markdown) and plots (SVG), all of them in evaluation.md.
set -euo pipefail
build=$(cd "$1" && pwd)
mkdir -p "$2"
out=$(cd "$2" && pwd)
shift 2
here=$(dirname "${BASH_SOURCE[0]}")
seed=1 full='' traces=../shared/data/traces mbit=16
while [ $# -gt 0 ]; do
  case $1 in
    --full) full=1 ;;
    --seed) seed=$2 && shift ;;
    --traces) traces=$2 && shift ;;
    *) echo "bench paper: unknown option $1" >&2 && exit 2 ;;
  esac
  shift
done
say() { printf '%s\n' "$*" >&2; }
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-paper.XXXXXX")
trap 'rm -rf "$work"' EXIT
# shellcheck source=bench/paper/real.sh
. "$here/real.sh"
POLICIES=(orbbuf uniform drop-oldest drop-youngest random)
PEERS=(roscpp gstreamer plain)

if [ -n "$full" ]; then
  street_frames=600 outages=(1 2 3 4) needs=(0.5 1 2) repeats=3
else
  street_frames=400 outages=(2 3) needs=(1) repeats=1
fi
began=$EPOCHSECONDS
rm -rf "$out/real"
world=$build/bench/paper/orbbuf-world trial=$build/bench/paper/orbbuf-trial
"$world" "$work/corridor" --seed "$seed"
"$world" "$work/street" --seed "$seed" --place street --size 1241x376 --stereo --fps 10 \
  --frames $street_frames

sessions=()
: >"$work/outages"
real() { # OUTAGE_S EVERY_S FIRST_S CONTENDER...
  contend "$work/corridor" "$@"
  local first=$3 contender name
  shift 3
  for contender in "$@"; do
    name=$contender@$first
    [ -s "$out/real/$name/summary" ] || continue
    sessions+=(--session "$name=$out/real/$name")
    awk -v n="$name" '{ print n, $3, $4 }' "$out/real/$name/outages" >>"$work/outages"
  done
}
if [ "$(id -u)" -eq 0 ] && ip netns add "orbbuf-probe-$$" 2>/dev/null; then
  ip netns del "orbbuf-probe-$$"
  real 2 6 4 "${POLICIES[@]}"
  real 2 6 7 "${POLICIES[@]}" "${PEERS[@]}"
  [ -z "$full" ] || for first in 4 8; do real 4 8 $first "${POLICIES[@]}"; done
else
  say 'bench paper: skipped: the real link (no network namespaces here, or not root)'
fi
run=(--run tolerance --run interruption --run buffer)
[ ${#sessions[@]} -eq 0 ] || run+=(--run sessions --outage-list "$work/outages" "${sessions[@]}")
"$trial" "$work/corridor" "${run[@]}" --outages "${outages[@]}" --seed "$seed" --out "$out" |
  tee "$out/corridor.log" | grep -v ^RESULT
"$trial" "$work/street" --run traces --needs "${needs[@]}" --repeats $repeats --seed "$seed" \
  --traces "$traces" --out "$out" | tee "$out/street.log" | grep -v ^RESULT
if [ -n "$full" ]; then # sec. IV-A: smaller images through compression do not help
  "$world" "$work/poor" --seed "$seed" --quality 10
  "$trial" "$work/poor" --run interruption --outages "${outages[@]}" --seed "$seed" \
    --out "$out/quality10" | sed 's/paper\.interruption/paper.interruption_quality10/' |
    tee "$out/poor.log" | grep -v ^RESULT
fi
peer_table >"$out/peers.md"
gnuplot -c "$here/plots.gp" "$out"

# shellcheck source=bench/paper/report.sh
. "$here/report.sh"
write_report >"$out/evaluation.md"
say "bench paper: $((EPOCHSECONDS - began)) s; everything is in $out, evaluation.md first"
grep -h ^RESULT "$out"/*.log
peer_results 7

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The paper's evaluation (sec. III-F and IV): renders a world, lets contenders send it over real TCP
# and over simulated links, and judges what arrived.
# Usage: bench/paper/run.sh BUILD_FOLDER OUT_FOLDER [--full] [--seed N] [--traces FOLDER]
#          [--only real|simulated]
# OUT_FOLDER gets CSV, tables (Markdown) and plots (SVG), all of them in evaluation.md.
set -euo pipefail
build=$(cd "$1" && pwd)
mkdir -p "$2"
out=$(cd "$2" && pwd)
shift 2
here=$(dirname "${BASH_SOURCE[0]}")
seed=1 full='' only='' traces=../shared/data/traces mbit=16
while [ $# -gt 0 ]; do
  case $1 in
    --full) full=1 ;;
    --seed) seed=$2 && shift ;;
    --traces) traces=$2 && shift ;;
    --only) only=$2 && shift ;;
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
  street_frames=600 outages=(1 2 3 4)
  mobile=(--needs 0.5 1 2 --repeats 10 --buffers 20 5 10 15 25 30 35)
else
  street_frames=400 outages=(2 3)
  mobile=(--needs 1 --repeats 4 --policies orbbuf drop-oldest)
fi
wants() { [ -z "$only" ] || [ "$only" = "$1" ]; }
began=$EPOCHSECONDS
world=$build/bench/paper/orbbuf-world trial=$build/bench/paper/orbbuf-trial
"$world" "$work/corridor" --seed "$seed"

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
if ! wants real; then
  :
elif [ "$(id -u)" -eq 0 ] && ip netns add "orbbuf-probe-$$" 2>/dev/null; then
  ip netns del "orbbuf-probe-$$"
  rm -rf "$out/real"
  real 2 6 4 "${POLICIES[@]}"
  real 2 6 7 "${POLICIES[@]}" "${PEERS[@]}"
  [ -z "$full" ] || for first in 4 8; do real 4 8 $first "${POLICIES[@]}"; done
else
  say 'bench paper: skipped: the real link (no network namespaces here, or not root)'
fi

try() { # LOG WORLD ARGUMENT...: prints what orbbuf-trial does but the results, which come last
  "$trial" "$work/$2" --seed "$seed" --out "${results:-$out}" "${@:3}" >"$out/$1.log"
  grep -v ^RESULT "$out/$1.log"
}
if [ ${#sessions[@]} -gt 0 ]; then
  try real corridor --run sessions --outage-list "$work/outages" "${sessions[@]}"
  peer_table >"$out/peers.md"
  peer_results 7 >>"$out/real.log"
fi
if wants simulated; then
  try corridor corridor --run tolerance --run interruption --run buffer --outages "${outages[@]}"
  "$world" "$work/street" --seed "$seed" --place street --size 1241x376 --stereo --fps 10 \
    --frames $street_frames
  try street street --run traces --run enqueue --traces "$traces" "${mobile[@]}"
fi
if wants simulated && [ -n "$full" ]; then # sec. IV-A: smaller images through compression do not help
  "$world" "$work/poor" --seed "$seed" --quality 10
  results=$out/quality10 try poor poor --run interruption --outages "${outages[@]}"
  sed -i 's/paper\.interruption/paper.interruption_quality10/' "$out/poor.log"
fi
gnuplot -c "$here/plots.gp" "$out"

# shellcheck source=bench/paper/report.sh
. "$here/report.sh"
write_report >"$out/evaluation.md"
say "bench paper: $((EPOCHSECONDS - began)) s; everything is in $out, evaluation.md first"
cat "$out"/*.log | grep ^RESULT

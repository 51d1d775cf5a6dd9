#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The paper's evaluation (sec. III-F and IV): renders a world, sends it over real TCP and over
# simulated links under each policy, and tracks the camera with the frames that arrived.
# Usage: evaluation/run.sh BUILD_FOLDER OUT_FOLDER [--full] [--seed N] [--traces FOLDER]
#          [--only real|simulated]
# OUT_FOLDER loses what an earlier run left there, all CSV, Markdown, SVG and logs, and gets new ones, with
# everything in evaluation.md.
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
case $only in
  '' | real | simulated) ;;
  *) echo "bench paper: --only takes real or simulated, not $only" >&2 && exit 2 ;;
esac
say() { printf '%s\n' "$*" >&2; }
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-paper.XXXXXX")
finish() {
  local running
  mapfile -t running < <(jobs -p)
  [ ${#running[@]} -eq 0 ] || kill "${running[@]}" 2>/dev/null || true
  wait
  rm -rf "$work"
}
trap finish EXIT
# shellcheck source=evaluation/real/contend.sh
. "$here/real/contend.sh"
POLICIES=(catch-up orbbuf uniform drop-oldest drop-youngest random)
PEERS=(roscpp gstreamer jpegenc plain)
TRACES=(ghent/report_car_000{1,2,3,4}.json
  mahimahi/{ATT-LTE-driving-2016,TMobile-LTE-short,Verizon-LTE-short}.up)

if [ -n "$full" ]; then
  street_frames=600 outages=(1 2 3 4 5 10) real_begins=(7 4)
  mobile=(--needs 0.5 1 2 --repeats 10 --buffers 20 5 10 15 25 30 35)
  mobile_traces=("${TRACES[@]}")
else
  street_frames=400 outages=(2 3 5) real_begins=(7)
  mobile=(--needs 1 --repeats 4 --policies catch-up orbbuf drop-oldest)
  mobile_traces=(ghent/report_car_0002.json)
fi
wants() { [ -z "$only" ] || [ "$only" = "$1" ]; }
began=$EPOCHSECONDS
# Nothing of an earlier run is to be taken for this one's.
rm -rf "$out"/{real,latency,mobile,quality10} "$out"/*.{log,md,csv,dat,svg}
world=$build/evaluation/orbbuf-world trial=$build/evaluation/orbbuf-trial
"$world" "$work/corridor" --seed "$seed"

has_street=
street() { # once, by who needs it
  [ -z "$has_street" ] || return 0
  has_street=1
  "$world" "$work/street" --seed "$seed" --place street --size 1241x376 --stereo --fps 10 \
    --frames $street_frames
}
try() { # LOG WORLD ARGUMENT...: prints what orbbuf-trial does but the results, which come last
  "$trial" "$work/$2" --seed "$seed" --out "${results:-$out}" "${@:3}" >"$out/$1.log"
  grep -v ^RESULT "$out/$1.log"
}
score_outages() { # GROUP RESULT_NAME
  sessions_of "$1"
  [ ${#sessions[@]} -gt 0 ] || return 0
  outages_of "$1" >"$work/outages"
  results=$out/$1 try "$1" corridor --run sessions --result "$2" --outage-list "$work/outages" \
    "${sessions[@]}"
}
real_link() {
  local contenders=("${POLICIES[@]}" "${PEERS[@]}") name stream bytes_per_s first outage
  encode_for_jpegenc "$work/corridor"
  for first in "${real_begins[@]}"; do
    for outage in 2 3 5; do
      contend real "${outage}s-from-$first" "$work/corridor" cut 25 $outage $((outage + 4)) "$first" "${contenders[@]}"
    done
  done
  score_outages real paper.real
  peer_table real >"$out/peers.md"
  peer_results 2s-from-7 >>"$out/real.log"
  # Sec. IV-A: 50 frames at 25 fps are 1000 ms late.
  contend latency 2s-from-7 "$work/corridor" delay 25 2 6 7 "${contenders[@]}"
  score_outages latency paper.late

  street
  stream=$(find "$work"/street/images* -name '*.jpg' -printf '%s\n' |
    awk -v n=$street_frames '{ sum += $1 } END { printf "%.0f", sum / n * 10 }')
  for name in "${mobile_traces[@]}"; do
    if [ ! -e "$traces/$name" ]; then
      say "bench paper: skipped: no $traces/$name"
      continue
    fi
    case $name in
      ghent/*) bytes_per_s=$stream ;;
      *) bytes_per_s=0 ;; # as it was
    esac
    contend mobile "$(basename "${name%.*}")" "$work/street" "$traces/$name:$bytes_per_s:0" 20 0 0 1000 \
      "${POLICIES[@]}"
  done
  sessions_of mobile
  [ ${#sessions[@]} -eq 0 ] || try mobile street --run paths "${sessions[@]}"
}
if ! wants real; then
  :
elif [ "$(id -u)" -eq 0 ] && ip netns add "orbbuf-probe-$$" 2>/dev/null; then
  ip netns del "orbbuf-probe-$$"
  real_link
else
  say 'bench paper: skipped: the real link (no network namespaces here, or not root)'
  [ -z "$only" ] || exit 77
fi

if wants simulated; then
  try corridor corridor --run tolerance --run interruption --run buffer --outages "${outages[@]}"
  street
  try street street --run traces --run enqueue --traces "${TRACES[@]/#/$traces/}" "${mobile[@]}"
fi
# Sec. IV-A: smaller images through compression do not help. Here the link is slower by as much, so it is no
# news that they do not; what is seen is whether the reference VO tracks such images, and survives the outages.
if wants simulated && [ -n "$full" ]; then
  "$world" "$work/poor" --seed "$seed" --quality 10
  results=$out/quality10 try poor poor --run interruption --outages "${outages[@]}"
  sed -i 's/paper\.interruption/paper.interruption_quality10/' "$out/poor.log"
fi
gnuplot -c "$here/plots.gp" "$out"

# shellcheck source=evaluation/report.sh
. "$here/report.sh"
write_report >"$out/evaluation.md"
say "bench paper: $((EPOCHSECONDS - began)) s; everything is in $out, evaluation.md first"
cat "$out"/*.log | grep ^RESULT || { say 'bench paper: no results' && exit 1; }
[ ${#failed[@]} -eq 0 ] || { say "bench paper: failed: ${failed[*]}" && exit 1; }

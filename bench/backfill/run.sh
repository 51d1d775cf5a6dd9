#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A robot with a spool ([spool]) on a link of 1.3 times the need, through outages of 2 to 30 s: what became of every
# captured frame, and what the late frames cost the live stream. A second robot without a spool goes through the same
# outages at the same time, on a link of its own. After the last outage the robot ends, and a new one, which captures a
# frame a second, sends the rest. Takes root, for network namespaces.
# Usage: bench/backfill/run.sh BUILD_FOLDER [--seed N] [--minutes N] [--outages N]
set -euo pipefail
build=$(cd "$1" && pwd)
shift
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

FPS=25
IMAGES=250
seed=1 minutes=10 outages=20 side=
while [ $# -gt 0 ]; do
  case $1 in
    --seed) seed=$2 ;;
    --minutes) minutes=$2 ;;
    --outages) outages=$2 ;;
    --side) side=$2 shared=$3 && shift ;; # one of the two robots; its images are in the folder `shared`
    *) echo "bench/backfill/run.sh: unknown option $1" >&2 && exit 2 ;;
  esac
  shift 2
done

# shellcheck source=bench/link/rig.sh
. bench/link/rig.sh

# plan: lines WAIT OUTAGE in seconds, of all outages; evenly random between 2 and 30 s, and between each other.
plan() {
  awk -v seed="$seed" -v n="$outages" -v all="$((minutes * 60))" 'BEGIN {
    srand(seed)
    for (i = 0; i < n; ++i) { down[i] = 2 + 28 * rand(); sum += down[i] }
    if (sum > 0.6 * all) for (i = 0; i < n; ++i) down[i] *= 0.6 * all / sum # a short run
    sum = (sum > 0.6 * all) ? 0.6 * all : sum
    for (i = 0; i <= n; ++i) { part[i] = 0.3 + rand(); parts += part[i] }
    for (i = 0; i < n; ++i) printf "%.3f %.3f\n", (all - sum) * part[i] / parts, down[i]
    printf "%.3f 0\n", (all - sum) * part[n] / parts
  }'
}

# play: the outages; lines BEGIN END of each go to $work/cuts.
play() {
  local wait down begin
  while read -r wait down; do
    sleep "$wait"
    [ "$down" != 0 ] || break
    begin=$EPOCHREALTIME
    cut_link
    sleep "$down"
    mend_link
    echo "$begin $EPOCHREALTIME" >>"$work/cuts"
  done < <(plan)
}

start_robot() { # NAME FPS [SETTING...]
  local setting settings=()
  for setting in "${@:3}"; do settings+=(--set "$setting"); done
  start "$1" "${on_robot[@]}" "$build/daemon/orbbufd" --set robot.id=r --set log.level=debug \
    --set "link.server=$ADDRESS_cubic:$port" --set source.kind=folder --set "source.path=$shared/images" \
    --set "source.fps=$2" --set source.loop=true --set 'link.drain_timeout=1 s' "${settings[@]}"
}

# One of the two robots. Leaves $shared/SIDE, with what the server and the robots have written.
one_side() {
  local spool=() first port robot session ended
  trap rig_down EXIT
  rig_up
  # Not `shape`: its bucket of 32 KB would give a live frame what the gap before it has saved.
  tc -n "$robot_ns" qdisc replace dev wire root tbf rate "$(cat "$shared/mbit")mbit" burst 4kb latency 100ms
  [ "$side" = without ] || spool=("spool.path=$work/spool")
  start server "${on_server[@]}" "$build/server/orbbuf-server" --set "listen.address=$ADDRESS_cubic:0" \
    --set listen.insecure=true --set "files.path=$work/data"
  wait_for server 'listening on'
  port=$(grep -o 'listening on .*' "$work/server.err" | grep -o '[0-9]*$')
  start_robot robot $FPS "${spool[@]}"
  robot=${pids[-1]}
  wait_for robot 'connected to'
  until session=$(echo "$work"/data/r/*/images) && [ -d "$session" ]; do sleep 0.05; done
  session=$(dirname "$session")
  start watch "$build/bench/orbbuf-link-peer" watch "$session/images"
  play
  kill "$robot"
  wait "$robot" || true
  ended=$EPOCHREALTIME
  if [ "$side" = with ]; then
    # What the first session gave up at its end is there by then.
    start_robot later 1 "${spool[@]}"
    until grep -qsx 'on_robot 0' "$session/session.txt"; do sleep 0.2; done
    awk -v a="$ended" -v b="$EPOCHREALTIME" 'BEGIN { printf "%.0f\n", b - a }' >"$work/done_after"
  fi
  stop_from 0
  mkdir "$shared/$side"
  cp -r "$session" "$shared/$side/session"
  cp "$work"/{robot.err,watch.out,cuts} "$shared/$side"
  echo "$ended" >"$shared/$side/ended"
  cp "$work/done_after" "$shared/$side" 2>/dev/null || true
}

# lateness SIDE: lines NUMBER SECONDS of the live frames: from capture to the file. The replay's clock begins with its
# first frame; what the robot hands to the kernel at once says when that was. Live frames come by their numbers; one that
# comes behind a later one, or when the robot has ended, is late.
lateness() {
  awk -v fps=$FPS -v ended="$(cat "$shared/$1/ended")" '
    BEGIN { newest = -1 }
    FNR == NR { begin = $1 - $2 / fps; if (!anchor || begin < anchor) anchor = begin; next }
    { n = $3 + 0; if (n > newest && $1 <= ended) { newest = n; printf "%d %.4f %.3f\n", n, $1 - anchor - n / fps, $1 } }
  ' "$shared/$1/chosen" "$shared/$1/watch.out"
}

percentile() { sort -n | awk -v p="$1" '{ v[NR] = $1 } END { if (NR) print v[int(p * (NR - 1) / 100) + 1]; else print "-" }'; }

# steady SIDE: those lines of `lateness` whose frames are captured between outages, 5 s after the last one or later: the
# p95 of all frames is one of the frames that waited for an outage's end.
steady() {
  awk 'FNR == NR { begin[++n] = $1; end[n] = $2; next }
    { for (i = 1; i <= n; ++i) if ($3 > begin[i] && $3 - $2 < end[i] + 5) next; print }
  ' "$shared/$1/cuts" "$shared/$1/lateness"
}

# How long after each outage the stream is live: a frame less than 0.2 s after its capture.
live_again() { # SIDE
  awk 'FNR == NR { end[++n] = $2; next }
    { for (i = 1; i <= n; ++i) if (!done[i] && $3 > end[i] && $2 < 0.2) { done[i] = 1; print $3 - end[i] } }
  ' "$shared/$1/cuts" "$shared/$1/lateness"
}

# crcs_of FOLDER: a line CRC-32 BYTES NUMBER for each image, as gzip computes it.
crcs_of() {
  local image
  for image in "$1"/*.jpg; do
    echo "$(gzip -1c "$image" | tail -c 8 | od -An -tx4 | tr a-f A-F) $(basename "$image" .jpg)"
  done | awk '{ print $1, $2, $3 + 0 }'
}

# account: what became of each frame of the robot with a spool. An image is what was captured, or quality.csv names its
# size and CRC-32, if one was reduced.
account() {
  local session=$shared/with/session wrong named=()
  [ ! -e "$session/drops.csv" ] || named=("$session/drops.csv") # none, if all came
  wrong=$(awk -v n=$IMAGES -F '[ ,]' '
    FNR == 1 { ++file }
    file == 1 { sum[FNR - 1] = $1; next }
    file == 2 { if ($4 == sum[$1 % n]) reduced[$1] = 1; next }
    $1 != sum[$3 % n] && !reduced[$3] { ++wrong } END { print wrong + 0 }
    ' <(crcs_of "$shared/images") <(echo && cat "$session/quality.csv" 2>/dev/null) <(crcs_of "$session/images"))
  awk -F '[ ,]' -v wrong="$wrong" '
    FILENAME ~ /session.txt/ { of[$1] = $2; next }
    FILENAME ~ /times.txt/ { if ($1 in there) ++repeated; there[$1] = 1; ++delivered; next }
    /^[0-9]/ {
      if ($2 == "busy" || $2 == "failed") ++not_encoded; else ++lost
      if ($1 in there) ++unexplained
      named[$1] = 1
    }
    END {
      for (i = 0; i < of["captured"]; ++i) if (!(i in there) && !(i in named)) ++unexplained
      if (of["live"] + of["late"] != delivered) ++unexplained
      printf "RESULT backfill.captured %d\nRESULT backfill.live %d\nRESULT backfill.late %d\n", of["captured"], of["live"], of["late"]
      printf "RESULT backfill.not_encoded %d\nRESULT backfill.lost %d\nRESULT backfill.repeated %d\n", not_encoded, lost, repeated
      printf "RESULT backfill.unexplained %d\nRESULT backfill.wrong_bytes %d\n", unexplained, wrong
    }' "$session/session.txt" "$session/times.txt" "${named[@]}"
}

if [ -n "$side" ]; then
  one_side
  exit
fi

shared=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-backfill.XXXXXX")
cleanup() { rm -rf "$shared"; }
trap cleanup EXIT
(rig_up && make_images "$shared/images" $IMAGES 640 480) 2>&1 || exit $?
trap cleanup EXIT
cat "$shared"/images/*.jpg | wc -c | awk -v n=$IMAGES -v fps=$FPS '{ printf "%.3f\n", 1.3 * $1 / n * fps * 8e-6 }' >"$shared/mbit"
echo "backfill: seed $seed, $minutes minutes, $outages outages, $(cat "$shared/mbit") Mbit/s, 1.3 times the need"
sides=()
for one in with without; do
  bash "$0" "$build" --seed "$seed" --minutes "$minutes" --outages "$outages" --side "$one" "$shared" &
  sides+=($!)
done
for one in "${sides[@]}"; do wait "$one"; done
for one in with without; do
  work=$shared/$one
  mv "$work/robot.err" "$work/robot-robot.err"
  chosen robot >"$work/chosen"
  lateness "$one" >"$work/lateness"
done
account
echo "RESULT backfill.done_after_s $(cat "$shared/with/done_after")"
for one in with without; do
  echo "RESULT backfill.delivered_live.$one $(wc -l <"$shared/$one/lateness")"
  for part in 50 95; do
    echo "RESULT backfill.lateness_ms_p$part.$one $(awk '$2 < 0.5 { printf "%.1f\n", 1000 * $2 }' "$shared/$one/lateness" | percentile $part)"
    echo "RESULT backfill.steady_ms_p$part.$one $(steady "$one" | awk '{ printf "%.1f\n", 1000 * $2 }' | percentile $part)"
  done
  echo "RESULT backfill.live_again_s.$one $(live_again "$one" | percentile 50)"
done
"$build/server/orbbuf-server" check "$shared/with/session"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# One contender sends a folder of orbbuf-world over a cable of its own that goes dead again and again:
# the packets are dropped where they arrive. A contender is a policy of orbbufd's, or roscpp,
# gstreamer, plain. Exits with 77 where it is not installed.
# Usage: flow.sh BUILD WORLD OUT CONTENDER FIRST_S EVERY_S OUTAGE_S MBIT
# Writes to OUT: times.txt (what arrived), outages (wall clock: CUT MENDED FIRST LAST; the last two
# in frames), summary (LONGEST_GAP RETURN_MEDIAN_S RETURN_WORST_S CPU_MS_PER_FRAME PEAK_KIB DELIVERED).
set -euo pipefail
build=$(cd "$1" && pwd) world=$(cd "$2" && pwd) out=$3 contender=$4
first=$5 every=$6 outage=$7 mbit=$8
here=$(dirname "${BASH_SOURCE[0]}")
FPS=25 QUEUE=25
frames=$(wc -l <"$world/times.txt")
mkdir -p "$out"

# shellcheck source=bench/link/rig.sh
. "$here/../link/rig.sh"

# sample PID: what the kernel says of it, until it ends; the last line stands.
sample() {
  local hwm
  while hwm=$(awk '/^VmHWM/ { print $2 }' "/proc/$1/status" 2>/dev/null) && [ -n "$hwm" ]; do
    awk -v hwm="$hwm" '{ print ($14 + $15) * 10, hwm }' "/proc/$1/stat" 2>/dev/null || return 0
    sleep 0.25
  done
}

start_orbbufd() { # POLICY
  local port
  start server "${on_server[@]}" "$build/server/orbbuf-server" \
    --set "listen.address=$ADDRESS_cubic:0" --set listen.insecure=true --set "files.path=$work/frames"
  wait_for server 'listening on'
  port=$(grep -o 'listening on .*' "$work/server.err" | grep -o '[0-9]*$')
  start robot "${on_robot[@]}" "$build/daemon/orbbufd" --set robot.id=r \
    --set "link.server=$ADDRESS_cubic:$port" --set source.kind=folder \
    --set "source.path=$world/images" --set "buffer.policy=$1" --set buffer.capacity=$QUEUE
  wait_for robot 'source: '
}

start_receiver() {
  start "$contender" "${on_server[@]}" "$build/bench/paper/orbbuf-paper-peer" receive "$world" \
    "$ADDRESS_cubic" 5001
  wait_for "$contender" listening
}

start_plain() {
  start_receiver
  start robot "${on_robot[@]}" "$build/bench/paper/orbbuf-paper-peer" send "$world" "$ADDRESS_cubic" 5001
}

start_gstreamer() {
  if ! gst-inspect-1.0 multipartdemux >/dev/null 2>&1 || ! gst-inspect-1.0 tcpclientsink >/dev/null 2>&1; then
    say 'bench paper: skipped: gstreamer (Debian: gstreamer1.0-tools gstreamer1.0-plugins-base gstreamer1.0-plugins-good)'
    exit 77
  fi
  start_receiver
  mkfifo "$work/camera"
  "$build/bench/paper/orbbuf-paper-peer" film "$world" >"$work/camera" &
  pids+=($!)
  # shellcheck disable=SC2016 # for the inner shell
  start robot "${on_robot[@]}" bash -c 'exec gst-launch-1.0 "$@" <"$0"' "$work/camera" -q fdsrc ! multipartdemux boundary=part single-stream=true ! \
    image/jpeg ! queue leaky=downstream max-size-buffers=$QUEUE max-size-bytes=0 max-size-time=0 ! \
    tcpclientsink sync=false "host=$ADDRESS_cubic" port=5001
}

start_roscpp() {
  local peer=$build/bench/paper/orbbuf-paper-ros-peer
  start_ros "$peer" || exit 77
  start robot "${ros_on_robot[@]}" "$peer" send "$world" $FPS $QUEUE
}

rig_up
shape "$mbit"
case $contender in
  plain | gstreamer | roscpp) "start_$contender" ;;
  *) start_orbbufd "$contender" ;;
esac
robot=${pids[-1]}
[ ! -e "$work/$contender.out" ] || wait_for "$contender" '^00000'
sample "$robot" >"$work/samples" &
pids+=($!)

# sleep_until SECONDS: since the beginning.
begin=$EPOCHREALTIME
sleep_until() {
  sleep "$(awk -v b="$begin" -v n="$EPOCHREALTIME" -v t="$1" \
    'BEGIN { d = b + t - n; print (d > 0 ? d : 0) }')"
}
: >"$work/outages"
at=$first
while awk -v t="$at" -v o="$outage" -v f="$frames" -v r=$FPS 'BEGIN { exit !(t + o + 3 < f / r) }'; do
  sleep_until "$at"
  cut_link
  cut=$EPOCHREALTIME
  sleep_until "$(awk -v t="$at" -v o="$outage" 'BEGIN { print t + o }')"
  mended=$EPOCHREALTIME # before the command that mends it: never to anybody's advantage
  mend_link
  echo "$cut $mended" >>"$work/outages"
  at=$(awk -v t="$at" -v e="$every" 'BEGIN { print t + e }')
done
wait "$robot" || { say "bench paper: $contender failed: $(tail -n 3 "$work/robot.err")" && exit 1; }
sleep 0.5

if [ -d "$work/frames" ]; then
  find "$work"/frames/r/*/images -name '*.jpg' -printf '%f %T@\n' | sed 's/\.jpg//' | sort >"$work/arrivals"
else
  grep -E '^[0-9]{6} ' "$work/$contender.out" | sort >"$work/arrivals" # rosconsole says things there, too
fi
cp "$work/arrivals" "$out/arrivals"
[ -s "$work/arrivals" ] || { say "bench paper: nothing arrived of $contender" && exit 1; }
awk 'NR == FNR { seen[$1] = 1; next } $1 in seen' "$work/arrivals" "$world/times.txt" >"$out/times.txt"
# Frame 0 set out when the earliest of all arrivals says so.
base=$(awk -v f=$FPS '{ t = $2 - $1 / f; if (NR == 1 || t < b) b = t } END { printf "%.6f", b }' "$work/arrivals")
awk -v b="$base" -v f=$FPS '{ printf "%s %s %d %d\n", $1, $2, ($1 - b) * f, ($2 - b) * f }' \
  "$work/outages" >"$out/outages"
gap=$(awk 'NR > 1 && $1 - last - 1 > g { g = $1 - last - 1 } { last = $1 } END { print g + 0 }' "$work/arrivals")
returns=$(sort -k2n "$work/arrivals" | awk 'NR == FNR { mended[++n] = $2; next }
  { while (k < n && $2 > mended[k + 1]) printf "%.3f\n", $2 - mended[++k] }' "$work/outages" - | sort -n |
  awk '{ v[NR] = $1 } END { print v[int((NR + 1) / 2)], v[NR] }')
awk -v g="$gap" -v r="$returns" -v n="$frames" -v d="$(wc -l <"$work/arrivals")" \
  'END { printf "%d %s %.3f %d %d\n", g, r, $1 / n, $2, d }' "$work/samples" >"$out/summary"

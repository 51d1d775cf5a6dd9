#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# One contender sends a folder of orbbuf-world over a link of its own that fails again and again. A
# contender is a policy of orbbufd's, or roscpp, gstreamer, jpegenc, plain. Exits with 77 where it is
# not installed.
# Usage: flow.sh BUILD WORLD OUT CONTENDER LINK QUEUE MBIT FIRST_S EVERY_S OUTAGE_S SEED
# QUEUE: frames that may wait. SEED: of orbbufd's random policy. LINK is one of
#   cut      a cable of MBIT; in an outage the packets are dropped where they arrive
#   delay    of MBIT, too; in an "outage" all that the robot sends comes 1000 ms late
#   TRACE:BYTES_PER_S:OFFSET_S   a mobile link as orbbuf-evaluation-link plays it; nothing else fails
# jpegenc wants WORLD/jpegenc, which contend.sh makes.
# Writes to OUT: times.txt (what arrived), outages (wall clock: CUT MENDED FIRST LAST; the last two
# in frames), summary (LONGEST_GAP RETURN_MEDIAN_S RETURN_WORST_S LIVE_MEDIAN_S LIVE_WORST_S
# CPU_MS_PER_FRAME PEAK_KIB DELIVERED; see summary.sh).
set -euo pipefail
build=$(cd "$1" && pwd) world=$(cd "$2" && pwd) out=$3 contender=$4 link=$5 queue=$6
mbit=$7 first=$8 every=$9 outage=${10} seed=${11}
here=$(dirname "${BASH_SOURCE[0]}")
frames=$(wc -l <"$world/times.txt")
fps=$(awk 'NR == 1 { t = $2 } { d = $2 - t } END { printf "%.0f", (NR - 1) / d }' "$world/times.txt")
mkdir -p "$out"

# shellcheck source=bench/link/rig.sh
. "$here/../../bench/link/rig.sh"
# shellcheck source=evaluation/real/summary.sh
. "$here/summary.sh"

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
  local right=()
  [ ! -d "$world/images_right" ] || right=(--set "source.path_right=$world/images_right")
  # On a slow link what waits at the end may take its time.
  start robot "${on_robot[@]}" "$build/daemon/orbbufd" --set robot.id=r \
    --set "link.server=$ADDRESS_cubic:$port" --set source.kind=folder \
    --set "source.path=$world/images" "${right[@]}" --set "buffer.policy=$1" --set "buffer.capacity=$queue" \
    --set "buffer.seed=$seed" --set 'link.drain_timeout=60 s'
  wait_for robot 'source: '
}

start_receiver() { # FOLDER: of the JPEGs that will come
  start "$contender" "${on_server[@]}" "$build/evaluation/orbbuf-evaluation-peer" receive "$1" \
    "$ADDRESS_cubic" 5001
  wait_for "$contender" listening
}

start_plain() {
  start_receiver "$world"
  start robot "${on_robot[@]}" "$build/evaluation/orbbuf-evaluation-peer" send "$world" "$ADDRESS_cubic" 5001
}

# gstreamer PLAY ELEMENT...: a camera, as orbbuf-evaluation-peer plays it, then a leaky queue and TCP.
gstreamer() {
  mkfifo "$work/camera"
  "$build/evaluation/orbbuf-evaluation-peer" "$1" "$world" >"$work/camera" &
  pids+=($!)
  # shellcheck disable=SC2016 # for the inner shell
  start robot "${on_robot[@]}" bash -c 'exec gst-launch-1.0 "$@" <"$0"' "$work/camera" -q fdsrc ! "${@:2}" ! \
    queue leaky=downstream "max-size-buffers=$queue" max-size-bytes=0 max-size-time=0 ! \
    tcpclientsink sync=false "host=$ADDRESS_cubic" port=5001
}

# gstreamer_has ELEMENT...
gstreamer_has() {
  local element
  for element in "$@" tcpclientsink; do
    gst-inspect-1.0 "$element" >/dev/null 2>&1 || {
      say "bench paper: skipped: $contender (Debian: gstreamer1.0-tools gstreamer1.0-plugins-base gstreamer1.0-plugins-good)"
      exit 77
    }
  done
}

start_gstreamer() {
  gstreamer_has multipartdemux
  start_receiver "$world"
  gstreamer play multipartdemux boundary=part single-stream=true ! image/jpeg
}

start_jpegenc() {
  gstreamer_has rawvideoparse jpegenc
  local encode
  mapfile -t encode <"$world/jpegenc/elements"
  start_receiver "$world/jpegenc"
  gstreamer play-gray "${encode[@]}"
}

start_roscpp() {
  local peer=$build/evaluation/orbbuf-evaluation-ros-peer
  start_ros "$peer" || exit 77
  start robot "${ros_on_robot[@]}" "$peer" send "$world" "$fps" "$queue"
}

case $link in
  cut) ;;
  delay) rates=() ;;
  *) IFS=: read -ra rates <<<"$link" ;;
esac
if [ "$link" != cut ]; then
  lay_cable() { # within rig_up, which says what fails here
    mkfifo "$work/orders" || return
    # shellcheck disable=SC2016 # for the inner shell
    start wire bash -c 'exec "$@" <"$0"' "$work/orders" "$build/evaluation/orbbuf-evaluation-link" \
      "$robot_ns" "$server_ns" "${rates[@]}"
    exec {orders}>"$work/orders"
    (wait_for wire '^wire$')
  }
fi
begin_outage() { if [ "$link" = cut ]; then cut_link; else echo 'delay 1000' >&"$orders"; fi; }
end_outage() { if [ "$link" = cut ]; then mend_link; else echo 'delay 0' >&"$orders"; fi; }

rig_up
case $link in cut | delay) shape "$mbit" ;; esac
case $contender in
  plain | gstreamer | jpegenc | roscpp) "start_$contender" ;;
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
while awk -v t="$at" -v o="$outage" -v f="$frames" -v r="$fps" 'BEGIN { exit !(t + o + 3 < f / r) }'; do
  sleep_until "$at"
  begin_outage
  cut=$EPOCHREALTIME
  sleep_until "$(awk -v t="$at" -v o="$outage" 'BEGIN { print t + o }')"
  mended=$EPOCHREALTIME # before the command that mends it, so that no sender looks faster
  end_outage
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
base=$(awk -v f="$fps" '{ t = $2 - $1 / f; if (NR == 1 || t < b) b = t } END { printf "%.6f", b }' "$work/arrivals")
awk -v b="$base" -v f="$fps" '{ printf "%s %s %d %d\n", $1, $2, ($1 - b) * f, ($2 - b) * f }' \
  "$work/outages" >"$out/outages"
awk -v g="$(longest_gap "$work/arrivals" "$frames")" -v r="$(returns "$work/outages" "$work/arrivals")" \
  -v l="$(live_again "$work/outages" "$work/arrivals" "$fps")" \
  -v n="$frames" -v d="$(wc -l <"$work/arrivals")" \
  'END { printf "%d %s %s %.3f %d %d\n", g, r, l, $1 / n, $2, d }' "$work/samples" >"$out/summary"

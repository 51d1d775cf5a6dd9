#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What slow readers of ROS 2's topics cost the others. Two robots send images of 1280x1024 at 15 Hz, in a network
# namespace of its own. Reliable readers of the first one's raw images: a good one, one that takes less than half of
# them, and one that is stopped by SIGSTOP; of its JPEG images, of its inertial sensor (200 Hz), and of the other robot's
# raw images: a good one each. Two loops keep the processors busy; if root runs this, the robots and the server have the
# priority of their services. The good readers must get each message; none of them may wait for 2 s (a stall). A first
# run without the two bad readers tells what this machine can do (`alone`).
# Usage: bench/dds/run.sh BUILD_FOLDER [--quick] [--runs N] [--seconds N]; --quick: one run of 3 s, without the first one
set -euo pipefail
# shellcheck source=bench/dds/parts.sh
. "$(dirname "${BASH_SOURCE[0]}")/parts.sh"
build=$(cd "$1" && pwd)
shift
runs=10 seconds=20 rate=15 is_quick=
while [ $# -gt 0 ]; do
  case $1 in
    --quick) is_quick=1 runs=1 seconds=3 ;;
    --runs) runs=$2 && shift ;;
    --seconds) seconds=$2 && shift ;;
    *) echo "dds: unknown option $1" >&2 && exit 2 ;;
  esac
  shift
done
lay_network

end_all() {
  for pid in "${pids[@]}"; do kill -KILL "$pid" || true; done 2>/dev/null
  for pid in "${pids[@]}"; do wait "$pid" || true; done 2>/dev/null
  pids=()
}

images() { [ "$(grep -c '^[0-9]' "$logs/$1.log")" -ge "$2" ]; } # READER COUNT
busy() { while :; do :; done; }

good=(one-raw one-jpeg one-imu two-raw)
once() { # NAME [READER...]: with these beside the good ones
  logs=$work/$1
  mkdir "$logs"
  local readers=("${good[@]}" "${@:2}") stopped='' reader robot robots=()
  start one-raw "$build/bench/orbbuf-dds-timed-reader" one/image_raw raw
  start one-jpeg "$build/bench/orbbuf-dds-timed-reader" one/image_raw/compressed compressed
  start one-imu "$build/bench/orbbuf-dds-timed-reader" one/imu0 imu
  start two-raw "$build/bench/orbbuf-dds-timed-reader" two/image_raw raw
  for reader in "${@:2}"; do
    case $reader in
      slow) start slow "$build/bench/orbbuf-dds-timed-reader" one/image_raw raw $((2500 / rate)) ;;
      stopped) start stopped "$build/bench/orbbuf-dds-timed-reader" one/image_raw raw && stopped=${pids[-1]} ;;
    esac
  done
  for reader in "${readers[@]}"; do until_true "$reader is ready" says "$reader" ready; done
  start server nice -n -10 "$build/server/orbbuf-server" --set listen.address=127.0.0.1:0 --set "files.path=$logs/data" \
    --set dds.enabled=true
  until_true 'the server listens' says server 'listening on'
  sleep 4 # it publishes nothing in its first 3 s, and would then have to catch up
  for robot in one two; do
    start "robot-$robot" nice -n -10 "$build/daemon/orbbufd" --set "robot.id=$robot" --set buffer.policy=drop-oldest \
      --set "link.server=$(sed -n 's/.*listening on //p' "$logs/server.log")" --set source.width=1280 \
      --set stream.imu0.kind=generated --set source.height=1024 --set "source.fps=$rate" --set "source.frames=$((rate * (seconds + 10)))"
    robots+=("${pids[-1]}")
  done
  for reader in "${readers[@]}"; do until_true "$reader has images" images "$reader" 5; done
  start loop-1 busy
  start loop-2 busy
  [ -z "$stopped" ] || kill -STOP "$stopped"
  date +%s.%N >"$logs/begin"
  sleep "$seconds"
  date +%s.%N >"$logs/end"
  kill -TERM "${robots[@]}"
  wait "${robots[@]}" || fail "a robot ended with $?"
  local came='' before=none
  while [ "$came" != "$before" ]; do # until nothing comes for as long as a stall lasts
    before=$came
    sleep 2
    came=$(cd "$logs" && wc -l "${good[@]/%/.log}")
  done
  end_all
}

# judge READER ROBOT: appends its messages' delays in ms, since capture and since the server's write, to `delays`; prints
# how many it lost, and the longest time without one, in ms.
judge() {
  local is_imu=
  [ "$1" != one-imu ] || is_imu=1
  awk -v is_imu="$is_imu" -v begin="$(cat "$logs/begin")" -v end="$(cat "$logs/end")" -v delays="$logs/delays${is_imu:+-imu}" '
    function want(time) { if (time >= begin && time < end) wanted[time] = 1 }
    FILENAME ~ /times.txt$/ { if (!is_imu) want($2); next }
    FILENAME ~ /data.csv$/ { if (is_imu && /^[0-9]/) want(substr($1, 1, 10) "." substr($1, 11, 9)); next }
    /^[0-9]/ {
      came = $1 + $2
      if (came > begin && came < end) { if (came - last > gap && last > 0) gap = came - last; last = came }
      if ($1 in wanted) { delete wanted[$1]; printf "%.1f %.1f\n", $2 * 1000, $3 * 1000 >>delays }
    }
    END {
      if (end - last > gap) gap = end - last
      for (time in wanted) ++lost
      printf "%d %d\n", lost, gap * 1000
    }' "$logs"/data/"$2"/*/{times.txt,imu0/data.csv} "$logs/$1.log"
}

lost=0 stalls=0
tell() { # what became of the good readers' messages
  local reader missing gap line=''
  for reader in "${good[@]}"; do
    read -r missing gap <<<"$(judge "$reader" "${reader%-*}")"
    lost=$((lost + missing))
    [ "$gap" -lt 2000 ] || stalls=$((stalls + 1))
    line+=" $reader lost $missing, longest wait $gap ms;"
  done
  echo "dds: ${logs##*/}:${line%;}"
}
percentile() { # OF FIELD FILE...
  cut -d' ' -f"$2" "${@:3}" | sort -n | awk -v p="$1" '{ v[NR] = $1 } END { print v[int((NR - 1) * p) + 1] }'
}
[ -n "$is_quick" ] || { once alone && tell; }
lost=0 stalls=0
for run in $(seq "$runs"); do
  once "run-$run" slow stopped
  tell
done
result() { echo "RESULT dds.slow_reader.$1 $2"; }
result runs "$runs"
result images "$(cat "$work"/run-*/delays | wc -l)"
result samples "$(cat "$work"/run-*/delays-imu | wc -l)"
result others_lost "$lost"
for kind in 'p50_ms 0.5 1' 'p99_ms 0.99 1' 'since_write_p50_ms 0.5 2' 'since_write_p99_ms 0.99 2'; do
  read -r name part field <<<"$kind"
  [ -n "$is_quick" ] || result "alone_$name" "$(percentile "$part" "$field" "$work/alone/delays")"
  result "others_$name" "$(percentile "$part" "$field" "$work"/run-*/delays)"
  result "samples_$name" "$(percentile "$part" "$field" "$work"/run-*/delays-imu)"
done
result stalls "$stalls"
[ "$lost" -eq 0 ] && [ "$stalls" -eq 0 ]

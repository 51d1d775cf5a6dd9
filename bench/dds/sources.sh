#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A camera by its topic of ROS 2 against one that orbbufd captures itself (the generated scene), 25 images of 320x240 a
# second each, through the same link in the same run, with cuts of 2 s, as ROS 2 readers at the server see them. And what
# a TurtleBot3's other topics cost: one orbbufd has the camera alone, one has them too. The topic's images are the first 50
# of the camera, so that all are of a size. In a network namespace of its own.
# --device: a V4L2 camera, with 320x180, instead of the scene.
# Usage: bench/dds/sources.sh BUILD_FOLDER [--cuts N] [--device FILE]
set -euo pipefail
# shellcheck source=bench/dds/parts.sh
. "$(dirname "${BASH_SOURCE[0]}")/parts.sh"
build=$(cd "$1" && pwd)
shift
cuts=5 device='' height=240
while [ $# -gt 0 ]; do
  case $1 in
    --cuts) cuts=$2 && shift ;;
    --device) device=$2 height=180 && shift ;;
    *) echo "sources: unknown option $1" >&2 && exit 2 ;;
  esac
  shift
done
lay_network

start server "$build/server/orbbuf-server" --set listen.address=127.0.0.1:0 --set "files.path=$work/data" --set dds.enabled=true \
  --set dds.pace=1000
until_true 'the server listens' says server 'listening on'
address=$(sed -n 's/.*listening on //p' "$work/server.log" | head -n 1)
mode=(--set source.width=320 --set "source.height=$height" --set source.fps=25)
scene=(--set source.kind=generated "${mode[@]}")
images_of_pictures() { [ "$(cat "$work"/data/pictures/*/times.txt 2>/dev/null | wc -l)" -ge "$1" ]; } # COUNT
robots=(captured topic all)
declare -A pid_of
for robot in "${robots[@]}"; do
  start "by-$robot" "$build/bench/orbbuf-dds-timed-reader" "$robot/image_raw/compressed" compressed
done
run_robot() { # NAME SETTING...
  start "$1" "$build/daemon/orbbufd" --set "robot.id=$1" --set "link.server=$address" "${@:2}"
  pid_of[$1]=${pids[-1]}
}
run_captured() { # NAME: frames of the camera
  if [ -n "$device" ]; then
    run_robot "$1" --set source.kind=v4l2 --set "source.device=$device" --set source.format=YUYV "${mode[@]}"
  else
    run_robot "$1" "${scene[@]}" --set source.frames=100000
  fi
}
run_captured pictures # which the topic has, too
until_true 'there are pictures' images_of_pictures 50
kill -TERM "${pid_of[pictures]}"
wait "${pid_of[pictures]}" || fail "the pictures ended with $?"
camera=(--set source.kind=ros2 --set source.topic=/image_raw/compressed)
streams=()
for topic in imu odom tf tf_static scan; do
  streams+=(--set "stream.$topic.kind=topic" --set "stream.$topic.topic=/$topic")
done
run_robot topic "${camera[@]}"
run_robot all "${camera[@]}" "${streams[@]}"
start writer "$build/bench/orbbuf-dds-topic-writer" $((cuts * 10 + 10)) 1 "$work"/data/pictures/*/images/*.jpg
run_captured captured
for robot in "${robots[@]}"; do until_true "images of $robot" grep -q '^[0-9]' "$work/by-$robot.log"; done
ticks() { awk '{ print $14 + $15 }' "/proc/${pid_of[$1]}/stat"; }
declare -A before
for robot in "${robots[@]}"; do before[$robot]=$(ticks "$robot"); done
begin=$(date +%s.%N)
for _ in $(seq "$cuts"); do
  sleep 4
  nft add rule inet link input tcp dport "${address##*:}" drop
  sleep 2
  nft flush chain inet link input
  sleep 4
done
end=$(date +%s.%N)

percentile() { # ROBOT OF: how late images of that time are, in ms
  awk -v begin="$begin" -v end="$end" '/^[0-9]/ && $1 >= begin && $1 < end { print $2 * 1000 }' "$work/by-$1.log" | sort -n |
    awk -v p="$2" '{ v[NR] = $1 } END { printf "%.1f", v[int((NR - 1) * p) + 1] }'
}
gap() { # ROBOT: the longest time between two images that came, in periods
  sort "$work/by-$1.log" | awk -v begin="$begin" -v end="$end" '/^[0-9]/ && $1 >= begin && $1 < end {
    if (last > 0 && $1 - last > gap) gap = $1 - last; last = $1 } END { printf "%.0f", gap * 25 }'
}
cpu() { # ROBOT: in percent of a processor
  awk -v t="$(($(ticks "$1") - before[$1]))" -v hz="$(getconf CLK_TCK)" -v s="$(awk "BEGIN { print $end - $begin }")" \
    'BEGIN { printf "%.2f", t / hz / s * 100 }'
}
ratio() { awk "BEGIN { printf \"%.3f\", $1 / $2 }"; }
result() { echo "RESULT dds.source.$1 $2"; }
for robot in "${robots[@]}"; do
  result "$robot.late_p50_ms" "$(percentile "$robot" 0.5)"
  result "$robot.late_p95_ms" "$(percentile "$robot" 0.95)"
  result "$robot.late_max_ms" "$(percentile "$robot" 1)"
  result "$robot.gap" "$(gap "$robot")"
  result "$robot.cpu_percent" "$(cpu "$robot")"
done
result late_p50_ratio "$(ratio "$(percentile topic 0.5)" "$(percentile captured 0.5)")"
result late_p95_ratio "$(ratio "$(percentile topic 0.95)" "$(percentile captured 0.95)")"
result gap_ratio "$(ratio "$(gap topic)" "$(gap captured)")"

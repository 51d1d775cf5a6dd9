#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What orbbufd keeps in memory at 1280x1024 pixels beside the frames that wait: at its peak, without a
# server, so that the buffer is full and the policy looks at every frame. And how much it grows from the 10,000th
# to the 100,000th frame, small ones, delivered as fast as they are taken.
# Usage: bench/memory.sh BUILD_FOLDER
set -euo pipefail
name=memory
# shellcheck source=bench/programs.sh
. "$(dirname "${BASH_SOURCE[0]}")/programs.sh"

kib() { awk -v key="$2:" '$1 == key { print $2 }' "/proc/$1/status"; } # PID KEY

# Frames as a camera with MJPG gives them: the generated scene, compressed before.
jpegs() { # WIDTH HEIGHT
  serve listen.address=127.0.0.1:0 "files.path=$work/$1x$2"
  "$orbbufd" --set "link.server=$address" --set robot.id=r --set source.width="$1" \
    --set source.height="$2" --set source.frames=100 --set source.realtime=false >"$work/jpegs.log" 2>&1
  stop "$server_pid"
  images=$(echo "$work/$1x$2"/r/*/images)
}

peak() { # WIDTH HEIGHT
  jpegs "$1" "$2"
  "$orbbufd" --set link.server=127.0.0.1:1 --set robot.id=r --set source.kind=folder \
    --set "source.path=$images" --set source.loop=true --set source.fps=25 --set buffer.policy=orbbuf >"$work/peak.log" 2>&1 &
  local robot=$! buffer
  programs+=("$robot")
  await "$work/peak.log" ' dropped [1-9][0-9][0-9] .* waiting 25 '
  # 25 JPEGs and, of each, 500 features of 32 bytes.
  buffer=$((25 * ($(du -sk "$images" | cut -f1) / 100 + 16)))
  awk -v total="$(kib $robot VmHWM)" -v buffer=$buffer -v size="$1x$2" 'BEGIN {
    printf "memory: %d KiB at the peak, %d KiB of it frames that wait\n", total, buffer
    printf "RESULT ship.rss_mib.%s %.1f\n", size, (total - buffer) / 1024
    exit total - buffer >= 64 * 1024 }'
}

growth() {
  jpegs 320 240
  serve listen.address=127.0.0.1:0 files.enabled=false 'slam.command=cat >/dev/null' slam.format=mjpeg
  "$orbbufd" --set "link.server=$address" --set robot.id=r --set source.kind=folder \
    --set "source.path=$images" --set source.loop=true --set source.realtime=false >"$work/growth.log" 2>&1 &
  local robot=$! from to
  programs+=("$robot")
  await "$work/growth.log" ' acknowledged [0-9]\{5\} '
  from=$(kib $robot VmRSS)
  await "$work/growth.log" ' acknowledged [0-9]\{6\} '
  to=$(kib $robot VmRSS)
  echo "memory: $from KiB after 10,000 frames, $to KiB after 100,000"
  echo "RESULT ship.rss_growth_kib $((to - from))"
  [ $((to - from)) -le 1024 ]
}

peak 1280 1024
growth

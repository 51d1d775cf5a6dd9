#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Samples at 1 kHz beside frames at 25 Hz. First the robot is killed and started again, by turns in an outage and without one; what it
# had not delivered comes from its record. Then the server is killed and started again (the first outage is of 60 s, the others of 1 to
# 5 s, seeded). Compares what arrived with what the robot captured: of a robot that was killed, as far as its record knows.
# Usage: bench/samples/run.sh BUILD_FOLDER [--seed N] [--seconds N] [--outage SECONDS] [--robot-kills N]
set -euo pipefail
name=samples
# shellcheck source=bench/programs.sh
. "$(dirname "${BASH_SOURCE[0]}")/../programs.sh"
shift
seed=1 seconds=180 outage=60 robot_kills=4
while [ $# -gt 0 ]; do
  case $1 in
    --seed) seed=$2 ;;
    --seconds) seconds=$2 ;;
    --outage) outage=$2 ;;
    --robot-kills) robot_kills=$2 ;;
    *) echo "samples: unknown option $1" >&2 && exit 2 ;;
  esac
  shift 2
done
RANDOM=$seed

# Of the time of day, as the frames are; and what is not captured any more.
awk -v count=$(((seconds + 5) * 1000)) -v begin="$(date +%s)" 'BEGIN {
  for (i = 0; i < count; ++i)
    printf "%d%03d000137,%.6f,%.6f,0.25,0.125,-%.6f,9.81\n", begin + i / 1000, i % 1000, i / 7, i / 3, i / 11 }' \
  >"$work/data.csv"
start_robot() {
  "$orbbufd" --set "link.server=$address" --set robot.id=r --set source.width=320 --set source.height=240 \
    --set "source.frames=$((seconds * 25))" --set link.drain_timeout="1 min" --set "buffer.drop_log=$work/record" \
    --set "stream.imu0.path=$work/data.csv" >"$work/robot.log" 2>&1 &
  robot_pid=$!
  programs+=("$robot_pid")
}

serve listen.address=127.0.0.1:0 "files.path=$work/out"
for ((life = 0; life < robot_kills; ++life)); do
  start_robot
  sleep $((3 + RANDOM % 3)).$((RANDOM % 10))
  if [ $((life % 2)) -eq 0 ]; then
    stop "$server_pid" KILL
    sleep $((2 + RANDOM % 4)).$((RANDOM % 10))
  fi
  stop "$robot_pid" KILL
  [ $((life % 2)) -ne 0 ] || serve "listen.address=$address" "files.path=$work/out"
done
start_robot
SECONDS=0
kills=0
sleep 5
while kill -0 "$robot_pid" 2>/dev/null && [ $((SECONDS + 10)) -lt "$seconds" ]; do
  stop "$server_pid" KILL
  kills=$((kills + 1))
  if [ $kills -eq 1 ]; then sleep "$outage"; else sleep $((1 + RANDOM % 5)); fi
  serve "listen.address=$address" "files.path=$work/out"
  sleep $((3 + RANDOM % 5))
done
wait "$robot_pid"
programs=("$server_pid")
stop "$server_pid"

captured=0 delivered=0 lost=0 repeated=0 behind=0 differing=0
for session in "$work"/out/r/*/; do
  "$server" check "$session" >"$work/check" 2>&1 || true
  cat "$work/check"
  grep -v '^#' "$session/imu0/data.csv" | cut -d, -f1 >"$work/got"
  count=$(wc -l <"$work/got")
  # The same times, in the same order.
  cmp -s <(head -n "$count" "$work/data.csv" | cut -d, -f1) "$work/got" || differing=$((differing + 1))
  here=$(sed -n 's/.*imu0: [0-9]* samples,.* \([0-9]*\) \(lost\|missing\).*/\1/p' "$work/check")
  passed=$(sed -n 's/.*imu0: \([0-9]*\) samples came behind.*/\1/p' "$work/check")
  delivered=$((delivered + count)) lost=$((lost + here)) behind=$((behind + ${passed:-0}))
  captured=$((captured + count + here))
  repeated=$((repeated + $(sort "$work/got" | uniq -d | wc -l)))
done
# Of the last session, which was not killed, the robot itself says it.
own=$(sed -n 's/.*samples: imu0 captured \([0-9]*\) =.*/\1/p' "$work/robot.log")
captured=$((captured - count - here + own))
echo "samples: the robot was killed $robot_kills times, the server $kills times beside; seed $seed"
for result in "captured $captured" "delivered $delivered" "lost $lost" "repeated $repeated" "behind_newer_frame $behind"; do
  echo "RESULT samples.$result"
done
[ "$differing" -eq 0 ] && [ "$own" -gt 0 ] && [ "$captured" -eq "$delivered" ] && [ "$lost" -eq 0 ] && [ "$behind" -eq 0 ]

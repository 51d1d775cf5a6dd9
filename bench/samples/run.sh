#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Samples at 1 kHz beside frames at 25 Hz, while the server is killed and started again (the first outage is of 60 s, the others of 1 to 5 s, seeded):
# compares what arrived with what the robot captured.
# Usage: bench/samples/run.sh BUILD_FOLDER [--seed N] [--seconds N] [--outage SECONDS]
set -euo pipefail
name=samples
# shellcheck source=bench/programs.sh
. "$(dirname "${BASH_SOURCE[0]}")/../programs.sh"
shift
seed=1 seconds=180 outage=60
while [ $# -gt 0 ]; do
  case $1 in
    --seed) seed=$2 ;;
    --seconds) seconds=$2 ;;
    --outage) outage=$2 ;;
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
serve listen.address=127.0.0.1:0 "files.path=$work/out"
"$orbbufd" --set "link.server=$address" --set robot.id=r --set source.width=320 --set source.height=240 \
  --set "source.frames=$((seconds * 25))" --set link.drain_timeout="1 min" \
  --set "stream.imu0.path=$work/data.csv" >"$work/robot.log" 2>&1 &
robot_pid=$!
programs+=("$robot_pid")
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

session=$(echo "$work"/out/r/*/)
"$server" check "$session" >"$work/check" 2>&1 || true
cat "$work/check"
captured=$(sed -n 's/.*samples: imu0 captured \([0-9]*\) =.*/\1/p' "$work/robot.log")
lost=$(sed -n 's/.*imu0: [0-9]* samples, \([0-9]*\) lost.*/\1/p' "$work/check")
behind=$(sed -n 's/.*imu0: \([0-9]*\) samples came behind.*/\1/p' "$work/check")
delivered=$(grep -vc '^#' "$session/imu0/data.csv")
repeated=$(grep -v '^#' "$session/imu0/data.csv" | cut -d, -f1 | sort | uniq -d | wc -l)
# The same times, in the same order.
cut -d, -f1 "$work/data.csv" | head -n "$captured" >"$work/sent"
grep -v '^#' "$session/imu0/data.csv" | cut -d, -f1 >"$work/got"
differing=0
cmp -s "$work/sent" "$work/got" || differing=1
echo "samples: $kills times the server was killed; seed $seed"
for result in "captured $captured" "delivered $delivered" "lost $lost" "repeated $repeated" \
  "behind_newer_frame ${behind:-0}"; do
  echo "RESULT samples.$result"
done
[ "$differing" -eq 0 ] && [ "$captured" -gt 0 ] && [ "$captured" -eq "$delivered" ] && [ "$lost" = 0 ] &&
  [ "${behind:-0}" -eq 0 ]

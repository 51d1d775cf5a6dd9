#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The topics of a TurtleBot3, its camera among them, through a link that is cut and a server that publishes them again,
# in a network namespace of its own. Each message that orbbufd captured is compared with what came behind the server: its
# bytes, and when it was written. Beside it nodes of one thread read there with queues of 10 (/tf: 100, as tf2 has) and
# work for 30 ms at each image: one of Cyclone DDS, and one of Fast DDS if it is built. A depth image goes with each image
# that the link takes: `without_depth` images came without theirs, and `without_image` depth images.
# Usage: bench/dds/topics.sh BUILD_FOLDER [--cut SECONDS] [--restart] [--stop] [--writer PROGRAM] [--pace N]
#   --restart: the server, too, ends and begins again; --stop: another reliable reader of all topics behind the server is
#   stopped by SIGSTOP; --writer: in place of the one of Cyclone DDS; --pace: dds.pace;
#   with --cut 0 --pace 1000, `added_ms` is what the way through the link adds in the median, `added_p99_ms` to 99 % of the
#   messages, and `added_longest_ms` to the latest
set -euo pipefail
# shellcheck source=bench/dds/parts.sh
. "$(dirname "${BASH_SOURCE[0]}")/parts.sh"
build=$(cd "$1" && pwd)
shift
cut=2 pace=1.2 is_restarted='' is_stopped='' depth=depth writer=$build/bench/orbbuf-dds-topic-writer
while [ $# -gt 0 ]; do
  case $1 in
    --cut) cut=$2 && shift ;;
    --writer) writer=$(realpath "$2") depth='' && shift ;;
    --pace) pace=$2 && shift ;;
    --restart) is_restarted=1 ;;
    --stop) is_stopped=1 ;;
    *) echo "topics: unknown option $1" >&2 && exit 2 ;;
  esac
  shift
done
lay_network

messages() { grep -s "^$2 " "$work/$1.log" || true; } # TAP NAME
has_written() { [ "$(messages source odom | wc -l)" -ge "$1" ]; }

topics=(imu odom tf scan tf_static)
tap=$build/bench/orbbuf-dds-topic-tap fast_tap=$build/tests/orbbuf-fast-dds-topic-tap
start source "$tap" '' volatile
start behind "$tap" /robot_1 volatile
nodes=(node-of-cyclone)
start node-of-cyclone "$tap" /robot_1 volatile 10 30
[ ! -x "$fast_tap" ] || { nodes+=(node-of-fast) && start node-of-fast "$fast_tap" /robot_1 10 30; }
taps=(source behind)
[ -z "$is_stopped" ] || { taps+=(stopped) && start stopped "$tap" /robot_1 volatile && stopped=${pids[-1]}; }
for reader in "${taps[@]}" "${nodes[@]}"; do until_true "$reader is there" says "$reader" ready; done
serve() { # NAME ADDRESS
  start "$1" "$build/server/orbbuf-server" --set "listen.address=$2" --set "files.path=$work/data" --set dds.enabled=true \
    --set "dds.pace=$pace"
  until_true 'the server listens' says "$1" 'listening on'
}
serve server 127.0.0.1:0
server=${pids[-1]}
address=$(sed -n 's/.*listening on //p' "$work/server.log" | head -n 1)
"$build/daemon/orbbufd" --set robot.id=pictures --set "link.server=$address" --set source.kind=generated \
  --set source.width=320 --set source.height=240 --set source.fps=100 --set source.frames=50 >"$work/pictures.log" 2>&1 ||
  fail "the pictures ended with $?"
streams=()
for topic in "${topics[@]}"; do
  streams+=(--set "stream.$topic.kind=topic" --set "stream.$topic.topic=/$topic")
done
streams+=(--set stream.depth.kind=topic --set stream.depth.topic=/depth/image_raw/compressedDepth --set stream.depth.policy=frames)
start robot "$build/daemon/orbbufd" --set robot.id=robot-1 --set "link.server=$address" --set source.kind=ros2 \
  --set source.topic=/image_raw/compressed "${streams[@]}"
robot=${pids[-1]}
start writer "$writer" $((cut + 8)) 2 ${depth:+depth} "$work"/data/pictures/*/images/*.jpg # readers: the tap and orbbufd
until_true 'messages are written' has_written 60
[ -z "$is_stopped" ] || kill -STOP "$stopped"
nft add rule inet link input tcp dport "${address##*:}" drop
sleep "$cut"
if [ -n "$is_restarted" ]; then # before the link is back: what waits when a server ends goes without a pace
  kill -TERM "$server"
  wait "$server" || fail "the server ended with $?"
  serve server-again "$address"
fi
nft flush chain inet link input
until_true 'all is written' says writer '^done'
session=$(echo "$work"/data/robot-1/*)
written() { awk -v name="$1" '$1 == name { n += $2 } END { print n }' "$work/writer.log"; } # NAME
dropped() { (tail -n +2 "$session/drops.csv" 2>/dev/null || true) | wc -l; }
same() { [ "$(messages behind "$1" | wc -l)" -ge "$(written "$1")" ]; } # NAME: as many came behind as were written
same_images() {
  local kept
  kept=$(wc -l <"$session/times.txt")
  [ $((kept + $(dropped))) -ge "$(written camera)" ] && [ "$(messages behind camera | wc -l)" -ge "$kept" ]
}
SECONDS=0
for topic in "${topics[@]}"; do
  until same "$topic" || [ $SECONDS -gt $((20 + cut)) ]; do sleep 0.05; done
done
until same_images || [ $SECONDS -gt $((40 + cut)) ]; do sleep 0.05; done
start late "$build/bench/orbbuf-dds-topic-tap" /robot_1 latched
has_latched() { [ "$(messages late tf_static | wc -l)" -ge 2 ]; }
until_true 'a late reader has /tf_static of both publishers' has_latched
kill -TERM "$robot"
wait "$robot" || fail "the robot ended with $?"
has_ended() { [ -e "$session/session.txt" ]; }
until_true 'the session has ended' has_ended

status=0
unique() { messages "$1" "$2" | cut -d' ' -f"$3" | sort -u; } # TAP NAME FIELDS
# told NAME WRITTEN KEPT NAMED: how many came behind the server of those, of which the robot kept and named so many.
# An image may come with fewer bytes.
told() {
  local delivered lost repeated captured=$(($3 + $4)) fields=1-4
  [ "$1" != camera ] || fields=1,2
  delivered=$(comm -12 <(unique source "$1" $fields) <(unique behind "$1" $fields) | wc -l)
  lost=$(($2 - delivered - $4))
  repeated=$(($(messages behind "$1" | wc -l) - $(unique behind "$1" 1-4 | wc -l)))
  [ -z "$is_restarted" ] || [ "$1" != tf_static ] || repeated=0 # by the second server
  [ "$1" = tf_static ] || for result in captured delivered lost repeated; do
    echo "RESULT dds.$1.$result ${!result}"
  done
  echo "topics: $1: $2 written, $captured captured, $delivered came with their bytes and times, $4 named lost"
  [ "$captured" -eq "$2" ] && [ "$lost" -eq 0 ] && [ "$repeated" -eq 0 ] || status=1
}
for topic in "${topics[@]}"; do
  read -r _ _ kept _ _ _ named <<<"$(grep "^$topic delivered" "$session/session.txt")"
  told "$topic" "$(written "$topic")" "$kept" "$named"
  [ "$named" -eq 0 ] || status=1
  [ "$(tail -n +2 "$session/topics/$topic.csv" | wc -l)" -eq "$kept" ] || fail "topics/$topic.csv has not $kept lines"
  publishers() { grep -s "^publisher $topic " "$work/$1.log" | sort -u; }
  [ "$(publishers source)" = "$(publishers behind)" ] || fail "$topic: $(publishers behind), not $(publishers source)"
done
told camera "$(written camera)" "$(wc -l <"$session/times.txt")" "$(dropped)"
if [ "$depth" ]; then
  echo "RESULT dds.depth.delivered $(unique behind depth 2 | wc -l)"
  without_depth=$(comm -23 <(unique behind camera 2) <(unique behind depth 2) | wc -l)
  without_image=$(comm -13 <(unique behind camera 2) <(unique behind depth 2) | wc -l)
  echo "RESULT dds.depth.without_depth $without_depth"
  echo "RESULT dds.depth.without_image $without_image"
  # Of an image that was on its way when the link went, and that was then given up.
  [ "$without_depth" -eq 0 ] && [ "$without_image" -le 3 ] || status=1
fi
for node in "${nodes[@]}"; do
  missed=0
  for topic in camera imu odom tf scan; do
    missed=$((missed + $(comm -23 <(unique behind "$topic" 1,2) <(unique "$node" "$topic" 1,2) | tee -a "$work/missed-$node" | wc -l)))
  done
  echo "RESULT dds.${node//-/_}.missed $missed"
  cut -d' ' -f1 "$work/missed-$node" | sort | uniq -c
  # Some hundred without a pace. A busy machine lets a node oversleep, which then misses a few.
  [ "$cut" -gt 5 ] || [ "$pace" != 1.2 ] || [ "$missed" -le 10 ] || status=1
done
age() { # TAP NAME PART: of the later half of the messages, since the first ones wait for readers
  messages "$1" "$2" | cut -d' ' -f5 | awk '{ v[NR] = $1 } END { for (i = int(NR / 2) + 1; i <= NR; ++i) print v[i] }' |
    sort -n | awk -v p="$3" '{ v[NR] = $1 } END { print v[int((NR - 1) * p) + 1] }'
}
for topic in camera imu odom tf scan; do
  for part in 'ms 0.5' 'p99_ms 0.99' 'longest_ms 1'; do
    read -r name part <<<"$part"
    echo "RESULT dds.added_$name.$topic $(awk "BEGIN { print $(age behind "$topic" "$part") - $(age source "$topic" "$part") }")"
  done
done
echo "RESULT dds.late_behind_frame $("$build/server/orbbuf-server" check "$session" |
  awk '/came behind a newer frame/ { n += $3 } END { print n + 0 }')"
echo "RESULT dds.published_behind_frame $(awk '
  $1 == "camera" { if ($2 > newest) newest = $2; next }
  $1 ~ /^(imu|odom|tf|scan)$/ && $2 < newest { ++behind }
  END { print behind + 0 }' "$work/behind.log")"
[ $status -eq 0 ]

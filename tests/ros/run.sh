#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What orbbuf-server publishes to a real master, as subscribers of roscpp receive it, in a network namespace of its own
# (which takes root, or a kernel that lets users make them): run.sh BUILD.
set -euo pipefail
if [ -z "${ORBBUF_OWN_NAMESPACE-}" ]; then
  ORBBUF_OWN_NAMESPACE=1 exec unshare --net --map-root-user "$0" "$@"
fi
build=$(cd "$1" && pwd)
work=$(mktemp -d)
pids=()
cleanup() {
  for pid in "${pids[@]}"; do kill -TERM "$pid" || true; kill -CONT "$pid" || true; done 2>/dev/null
  wait
  rm -rf "$work"
}
trap cleanup EXIT
ip link set lo up
nft add table inet link
nft add chain inet link input '{ type filter hook input priority 0; }'
fail() { echo "ros: $*" >&2 && tail -n 20 "$work"/*.log >&2 && exit 1; }

start() { # NAME COMMAND...
  "${@:2}" >"$work/$1.log" 2>&1 &
  pids+=("$!")
}
until_line() { # NAME TEXT
  SECONDS=0
  until grep -q -- "$2" "$work/$1.log" 2>/dev/null; do
    [ $SECONDS -lt 30 ] || fail "$1 does not say $2"
    sleep 0.05
  done
}

export ROS_IP=127.0.0.1 ROS_HOME=$work/ros ROS_LOG_DIR=$work/ros
ROS_MASTER_URI=http://127.0.0.1:$((20000 + RANDOM % 10000))
export ROS_MASTER_URI

serve() { # NAME
  start "$1" "$build/server/orbbuf-server" --set listen.address=127.0.0.1:0 \
    --set "files.path=$work/data" --set ros.enabled=true
  server=${pids[-1]}
  until_line "$1" 'listening on'
  address=$(sed -n 's/.*listening on //p' "$work/$1.log")
}
end_server() {
  kill -TERM "$server"
  wait "$server" || fail "the server ended with $?"
}
serve server
camera='camera.calibration="RadTan 100 101 80 60 -0.1 0.01 0.001 -0.001\n160 120\nnone\n160 120\n0.1\n"'

capture() { # ID SEED FRAMES [SETTING]
  "$build/daemon/orbbufd" --set "robot.id=$1" --set "link.server=$address" --set "$camera" \
    --set source.kind=generated --set source.width=160 --set source.height=120 --set source.fps=50 \
    --set source.realtime=false --set "source.seed=$2" --set "source.frames=$3" \
    ${4+--set "$4"} >"$work/robot-$1.log" 2>&1 || fail "$1 ended with $?"
}
capture_pairs() { # ID LEFT RIGHT
  "$build/daemon/orbbufd" --set "robot.id=$1" --set "link.server=$address" --set "$camera" \
    --set source.kind=folder --set source.realtime=false \
    --set "source.path=$2/images" --set "source.path_right=$3/images" \
    >"$work/robot-$1.log" 2>&1 || fail "$1 ended with $?"
}
last_session() { find "$work/data/$1" -mindepth 1 -maxdepth 1 -printf '%T@ %p\n' | sort -n | tail -n 1 | cut -d' ' -f2; }
# has_all SESSION COUNT: it has each frame, but for those that a busy machine's robot skipped, at most a tenth.
has_all() {
  local frames drops=0
  frames=$(wc -l <"$1/times.txt")
  [ ! -e "$1/drops.csv" ] || drops=$(tail -n +2 "$1/drops.csv" | wc -l)
  [ $((frames + drops)) -eq "$2" ] && [ "$frames" -ge $(($2 * 9 / 10)) ]
}

# Without a master all goes on, and is said once.
capture a 3 100
capture b 4 100
grep -c 'no master at' "$work/server.log" | grep -qx 1 || fail 'the missing master is not said once'
has_all "$(last_session b)" 100 || fail 'a missing master has cost frames'
until_line server "b .*: ros: $(wc -l <"$(last_session b)/times.txt") frames of this session not published: the session is over"

# Nor does one that takes connections and says nothing hold anybody.
start master rosmaster --core -p "${ROS_MASTER_URI##*:}"
master=${pids[-1]}
SECONDS=0
until (exec 3<>"/dev/tcp/127.0.0.1/${ROS_MASTER_URI##*:}") 2>/dev/null; do
  [ $SECONDS -lt 30 ] || fail 'no master'
  sleep 0.05
done
kill -STOP "$master"
capture c 5 300
has_all "$(last_session c)" 300 || fail 'a master that has stopped has cost frames'
end_server
kill -CONT "$master"

serve server-again
mkdir "$work/received"
start listener "$build/tests/orbbuf-ros-listener" "$work/received" /mono_1 /ros_2/left /ros_2/right /inertial
for topic in {/mono_1,/ros_2/left,/ros_2/right}/{image_raw/compressed,camera_info}; do
  for ((try = 0; ; ++try)); do # a publisher's first messages are gone before it is found
    grep -sqx "receiving $topic" "$work/listener.log" && break
    [ $try -lt 10 ] || fail "nothing comes on $topic"
    capture mono-1 1 100
    capture_pairs 2 "$(last_session mono-1)" "$(last_session a)"
  done
done

capture mono-1 2 100
capture_pairs 2 "$(last_session a)" "$(last_session b)"

# equal BASE SESSION SIDE TX FRAME_ID: every frame of the session was received, and its calibration.
equal() {
  local sequence time _
  while read -r sequence time _; do
    cmp -s "$work/received$1/$time.jpg" "$2/$3/$(printf %06d "$sequence").jpg" || return 1
    [ "$(cat "$work/received$1/$time.info" 2>/dev/null)" = \
      "$5 160x120 plumb_bob 100.000000 101.000000 80.000000 60.000000 $4" ] || return 1
  done <"$2/times.txt"
}
for side in '/mono_1 mono-1 images 0.000000 mono_1' '/ros_2/left 2 images 0.000000 ros_2' \
  '/ros_2/right 2 images_right -10.000000 ros_2'; do
  read -r base robot folder tx frame_id <<<"$side"
  session=$(last_session "$robot")
  has_all "$session" 100 || fail "$robot: not 100 frames"
  SECONDS=0
  until equal "$base" "$session" "$folder" "$tx" "$frame_id"; do
    [ $SECONDS -lt 10 ] || fail "$base: what it received is not what is in $folder"
    sleep 0.2
  done
  echo "ros: $base: 100 frames, each with its stamp, its bytes and its calibration"
done

# Samples beside frames: each once, with its stamp and its values.
awk 'BEGIN { for (i = 0; i < 1000; ++i) printf "%.0f,%d,0.5,-1,0,%d,9.81\n", i * 5e6 + 1, i, -i }' >"$work/samples.csv"
for ((try = 0; ; ++try)); do
  grep -sqx 'receiving /inertial/imu0' "$work/listener.log" && break
  [ $try -lt 10 ] || fail 'no samples come'
  capture inertial 7 100 "stream.imu0.path=$work/samples.csv"
done
rm -f "$work/received/inertial"/*
capture inertial 7 100 "stream.imu0.path=$work/samples.csv"
session=$(last_session inertial)
samples=$(grep -vc '^#' "$session/imu0/data.csv")
has_samples() {
  local time x name
  [ "$(find "$work/received/inertial" -name '*.imu' | wc -l)" -eq "$samples" ] || return 1
  while IFS=, read -r time x _; do
    printf -v name '%d.%09d.imu' $((time / 1000000000)) $((time % 1000000000))
    [ "$(cat "$work/received/inertial/$name")" = \
      "inertial $x.000000 0.500000 -1.000000 0.000000 $([ "$x" -eq 0 ] || echo -n -)$x.000000 9.810000 -1.000000" ] || return 1
  done < <(grep -v '^#' "$session/imu0/data.csv")
}
[ "$samples" -ge 300 ] || fail "only $samples samples"
SECONDS=0
until has_samples; do
  [ $SECONDS -lt 10 ] || fail 'the samples received are not those in data.csv'
  sleep 0.2
done
echo "ros: /inertial/imu0: $samples samples, each with its stamp and its values"

# Pairs of raw images through an outage: queues of 100 get all, spread over some time.
capture long-a 3 1000
capture long-b 4 1000
pairs() { # NAME QUEUE WORK_MS
  start "$1" "$build/tests/orbbuf-ros-pairs" /ros_2_pairs "$2" "$3"
}
pairs pairs-100 100 0
has_pairs() { grep -sq "^pairs $2," "$work/$1.log"; } # NAME COUNT
until_true() { # SECONDS WHAT COMMAND...
  SECONDS=0
  until "${@:3}"; do
    [ $SECONDS -lt "$1" ] || fail "not within $1 s: $2"
    sleep 0.05
  done
}
start_pairs() { # NAME [SETTING]
  start "$1" "$build/daemon/orbbufd" --set robot.id=2-pairs --set "link.server=$address" --set "$camera" \
    --set buffer.policy=drop-oldest --set buffer.capacity=1000 --set source.kind=folder --set source.fps=50 \
    --set "source.path=$(last_session long-a)/images" --set "source.path_right=$(last_session long-b)/images" \
    ${2+--set "$2"}
  robot=${pids[-1]}
}
start_pairs robot-pairs
until_true 30 'pairs arrive' has_pairs pairs-100 100
pairs pairs-1 1 4
slow=${pids[-1]}
until_true 30 'pairs arrive' has_pairs pairs-1 100
nft add rule inet link input tcp dport "${address##*:}" drop
sleep 4 # the outage
nft flush chain inet link input
wait "$robot" || fail "2-pairs ended with $?"
frames=$(wc -l <"$(last_session 2-pairs)/times.txt")
has_all "$(last_session 2-pairs)" 1000 || fail "2-pairs: $frames of 1000 frames"
until_true 30 "all $frames pairs" has_pairs pairs-100 "$frames"
until_true 5 'a stereo camera' grep -q '^baseline 0.100$' "$work/pairs-100.log"
! grep 'same\|not' "$work/pairs-100.log" || fail 'wrong images'
echo "ros: queue 100: $frames of $frames pairs through an outage of 4 s, a stereo camera with baseline 0.1 m"
pace=$(tail -n 1 "$work/pairs-100.log")
echo "ros: queue 100: $pace"
echo "ros: queue 1, with 4 ms of work for each: $(tail -n 1 "$work/pairs-1.log")"
# At twice 50 per second 150 take 1.5 s; without ros.pace they arrive as fast as the link brings them.
pace=${pace##*in }
[ "${pace% ms}" -ge 1000 ] || fail 'the frames of the outage arrive at once'

# A subscriber that has stopped loses messages, which are counted; the other one has all.
kill -STOP "$slow"
start_pairs robot-pairs-again source.realtime=false
wait "$robot" || fail "2-pairs ended with $?"
all=$((frames + $(wc -l <"$(last_session 2-pairs)/times.txt")))
until_true 60 "all $all pairs" has_pairs pairs-100 "$all"
until_line server-again 'of this session not published: a subscriber of /ros_2_pairs/.* is slow'
kill -CONT "$slow"
echo "ros: a subscriber that stopped: $(grep -o '[0-9]* frames of this session not published: \(a sub\|the sess\)' \
  "$work/server-again.log" | tail -n 1 | cut -d' ' -f1) frames not published to it, the other one has $all of $all"

end_server

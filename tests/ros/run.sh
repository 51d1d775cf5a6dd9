#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What orbbuf-server publishes to a real master, as a subscriber of roscpp's hears it: run.sh BUILD.
set -euo pipefail
build=$(cd "$1" && pwd)
work=$(mktemp -d)
pids=()
cleanup() {
  for pid in "${pids[@]}"; do kill -TERM "$pid" || true; kill -CONT "$pid" || true; done 2>/dev/null
  wait
  rm -rf "$work"
}
trap cleanup EXIT
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

capture() { # ID SEED FRAMES
  "$build/daemon/orbbufd" --set "robot.id=$1" --set "link.server=$address" --set "$camera" \
    --set source.kind=generated --set source.width=160 --set source.height=120 --set source.fps=50 \
    --set "source.seed=$2" --set "source.frames=$3" >"$work/robot-$1.log" 2>&1 || fail "$1 ended with $?"
}
capture_pairs() { # ID LEFT RIGHT
  "$build/daemon/orbbufd" --set "robot.id=$1" --set "link.server=$address" --set "$camera" \
    --set source.kind=folder --set "source.path=$2/images" --set "source.path_right=$3/images" \
    >"$work/robot-$1.log" 2>&1 || fail "$1 ended with $?"
}
last_session() { find "$work/data/$1" -mindepth 1 -maxdepth 1 -printf '%T@ %p\n' | sort -n | tail -n 1 | cut -d' ' -f2; }

# Without a master all goes on, and is said once.
capture a 3 100
capture b 4 100
grep -c 'no master at' "$work/server.log" | grep -qx 1 || fail 'the missing master is not said once'
[ "$(wc -l <"$(last_session b)/times.txt")" -eq 100 ] || fail 'a missing master has cost frames'
until_line server 'b .*: ros: 100 frames of this session not published: the session is over'

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
[ "$(wc -l <"$(last_session c)/times.txt")" -eq 300 ] || fail 'a master that has stopped has cost frames'
end_server
kill -CONT "$master"

serve server-again
mkdir "$work/heard"
start listener "$build/tests/orbbuf-ros-listener" "$work/heard" /mono_1 /ros_2/left /ros_2/right
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

# equal BASE SESSION SIDE TX FRAME_ID: every frame of the session was heard, and its calibration.
equal() {
  local sequence time _
  while read -r sequence time _; do
    cmp -s "$work/heard$1/$time.jpg" "$2/$3/$(printf %06d "$sequence").jpg" || return 1
    [ "$(cat "$work/heard$1/$time.info" 2>/dev/null)" = \
      "$5 160x120 plumb_bob 100.000000 101.000000 80.000000 60.000000 $4" ] || return 1
  done <"$2/times.txt"
}
for side in '/mono_1 mono-1 images 0.000000 mono_1' '/ros_2/left 2 images 0.000000 ros_2' \
  '/ros_2/right 2 images_right -10.000000 ros_2'; do
  read -r base robot folder tx frame_id <<<"$side"
  session=$(last_session "$robot")
  [ "$(wc -l <"$session/times.txt")" -eq 100 ] || fail "$robot: not 100 frames"
  SECONDS=0
  until equal "$base" "$session" "$folder" "$tx" "$frame_id"; do
    [ $SECONDS -lt 10 ] || fail "$base: what was heard is not what is in $folder"
    sleep 0.2
  done
  echo "ros: $base: 100 frames, each with its stamp, its bytes and its calibration"
done

end_server

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Recordings of real sessions, read by MCAP's own library from the npm registry: ended, killed between
# two parts or in one, and continued: mcap.sh BUILD. Exits with 77 (skipped) where node, npm or the registry
# is missing.
set -euo pipefail
build=$1
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
work=$(mktemp -d)
pids=()
cleanup() {
  for pid in "${pids[@]}"; do kill -9 "$pid" 2>/dev/null || true; done
  rm -rf "$work"
}
trap cleanup EXIT

fail() { echo "mcap: $*" >&2 && tail -n 20 "$work"/*.log >&2 && exit 1; }
skip() { echo "mcap: skipped: $*" && exit 77; }

for tool in node npm; do command -v "$tool" >/dev/null || skip "no $tool"; done
mkdir -p "$build/node/mcap"
build=$(cd "$build" && pwd)
cd "$build/node/mcap"
[ -d node_modules/protobufjs ] || {
  echo '{"private": true}' >package.json
  npm install --no-audit --no-fund --ignore-scripts @mcap/core@2.2.2 protobufjs@7.4.0 >npm.log 2>&1 ||
    skip "npm install failed: $(tail -n 3 npm.log)"
}

camera='camera.calibration="RadTan 100 101 80 60 -0.1 0.01 0.001 -0.001\n160 120\nnone\n160 120\n0.1\n"'
small=(--set source.kind=generated --set source.width=160 --set source.height=120)
port=0

start_server() {
  : >"$work/server.log" # the last one's
  "$build/server/orbbuf-server" --set "listen.address=127.0.0.1:$port" --set "files.path=$work/data" \
    --set mcap.enabled=true --set 'mcap.split=200 ms' >"$work/server.log" 2>&1 &
  server=$!
  pids+=("$server")
  until grep -q 'listening on' "$work/server.log"; do
    kill -0 "$server" || fail 'the server has ended'
    sleep 0.02
  done
  port=$(sed -n 's/.*listening on .*://p' "$work/server.log")
}
stop_server() { # SIGNAL
  kill "-$1" "$server"
  wait "$server" || [ "$1" = KILL ] || fail "the server ended with $?"
}
start_robot() { # ID [ARGUMENT...]
  "$build/daemon/orbbufd" --set "robot.id=$1" --set "link.server=127.0.0.1:$port" "${@:2}" \
    >"$work/robot-$1.log" 2>&1 &
  robot=$!
  pids+=("$robot")
}
robot_ends() { wait "$robot" || fail "a robot ended with $?"; }
session_of() { echo "$work/data/$1"/*; }
frames_of() { cat "$work/data/$1"/*/times.txt 2>/dev/null | wc -l; }
until_frames() { # ID COUNT
  until [ "$(frames_of "$1")" -ge "$2" ]; do
    kill -0 "$robot" || fail 'the robot has ended too soon'
    sleep 0.01
  done
}
more_frames() { # ROBOT COUNT
  until_frames "$1" $(($(frames_of "$1") + $2))
}
check() { node "$here/mcap.mjs" "$1" "$(session_of "$2")" "$3" || fail "$2 is not what was sent"; }

start_server
start_robot mono "${small[@]}" --set "$camera" --set source.frames=300 --set source.realtime=false
robot_ends
start_robot plain "${small[@]}" --set source.frames=300 --set source.realtime=false \
  --set source.seed=2
robot_ends
start_robot stereo --set source.kind=folder --set "source.path=$(session_of mono)/images" \
  --set "source.path_right=$(session_of plain)/images" --set source.realtime=false \
  --set "$camera"
robot_ends
stop_server TERM
check whole mono yes
check whole plain no
check whole stereo yes

# Killed at any moment, and continued: nothing twice, nothing lost but what is named.
start_server
start_robot killed "${small[@]}" --set "$camera" --set source.fps=200 \
  --set source.frames=100000 --set buffer.policy=uniform --set buffer.capacity=10
# Each time more frames must come first: only then has the server taken back what a kill left over.
for _ in 1 2 3 4 5; do
  more_frames killed 150
  stop_server KILL
  "$build/server/orbbuf-server" views "$(session_of killed)" || fail 'no views'
  check killed killed yes
  start_server
done
more_frames killed 60
stop_server TERM
check whole killed yes # the robot waits, the session does not know whether it will go on
start_server
more_frames killed 60
kill -TERM "$robot"
robot_ends
stop_server TERM
check whole killed yes
[ "$(wc -l <"$(session_of killed)/drops.csv")" -gt 5 ] || fail 'no outage has cost a frame'
[ "$(find "$work/data/killed" -mindepth 1 -maxdepth 1 | wc -l)" -eq 1 ] || fail 'it was to be one session'
[ "$(find "$work/data/killed" -name '*.mcap' | wc -l)" -gt 2 ] || fail 'no parts'

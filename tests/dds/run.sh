#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What orbbuf-server publishes by DDS, as readers of Cyclone DDS and of Fast DDS receive it, in a network namespace of
# its own (which takes root, or a kernel that lets users make them): run.sh BUILD.
set -euo pipefail
# shellcheck source=bench/dds/parts.sh
. "$(dirname "${BASH_SOURCE[0]}")/../../bench/dds/parts.sh"
build=$(cd "$1" && pwd)
lay_network

serve() { # NAME ADDRESS
  start "$1" "$build/server/orbbuf-server" --set "listen.address=$2" --set "files.path=$work/data" \
    --set dds.enabled=true --set http.address=127.0.0.1:8080
  server=${pids[-1]}
  until_true "$1 listens" says "$1" 'listening on'
  address=$(sed -n 's/.*listening on //p' "$work/$1.log" | head -n 1)
}
end_server() {
  kill -TERM "$server"
  wait "$server" || fail "the server ended with $?"
}
camera='camera.calibration="RadTan 100 101 80 60 -0.1 0.01 0.001 -0.001\n160 120\nnone\n160 120\n0.1\n"'
robot=("$build/daemon/orbbufd" --set buffer.policy=drop-oldest --set buffer.capacity=1000)
capture() { # ID SEED FRAMES RATE [SETTING ...]
  local setting settings=()
  for setting in "${@:5}"; do settings+=(--set "$setting"); done
  start "robot-$1" "${robot[@]}" --set "robot.id=$1" --set "link.server=$address" --set source.kind=generated \
    --set source.width=160 --set source.height=120 --set "source.fps=$4" --set "source.seed=$2" \
    --set "source.frames=$3" "${settings[@]}"
}
session_of() { find "$work"/data*/"$1" -mindepth 1 -maxdepth 1 -printf '%T@ %p\n' | sort -n | tail -n 1 | cut -d' ' -f2; }
has_frames() { [ "$(cat "$work"/data*/"$1"/*/times.txt 2>/dev/null | wc -l)" -ge "$2" ]; } # ROBOT COUNT

# received READER BASE SESSION FOLDER: how many of the session's frames it has, byte for byte.
received() {
  local sequence time _ count=0
  while read -r sequence time _; do
    ! cmp -s "$work/$1/$2/$time.jpg" "$3/$4/$(printf %06d "$sequence").jpg" || count=$((count + 1))
  done <"$3/times.txt"
  echo "$count"
}
received_all() { [ "$(received "$@")" -eq "$(wc -l <"$3/times.txt")" ]; }
received_some() { local time; read -r _ time _ <"$3/times.txt" && [ -e "$work/$1/$2/$time.jpg" ]; } # READER BASE SESSION
# has_all SESSION COUNT: it has each frame, but for those that a busy machine's robot skipped, at most a tenth.
has_all() {
  local frames drops=0
  frames=$(wc -l <"$1/times.txt")
  [ ! -e "$1/drops.csv" ] || drops=$(tail -n +2 "$1/drops.csv" | wc -l)
  [ $((frames + drops)) -eq "$2" ] && [ "$frames" -ge $(($2 * 9 / 10)) ]
}
metrics() {
  exec 3<>/dev/tcp/127.0.0.1/8080
  printf 'GET /metrics HTTP/1.1\r\nHost: 127.0.0.1:8080\r\nConnection: close\r\n\r\n' >&3
  cat <&3
  exec 3>&-
}
has_another() { [ "$(session_of "$1")" != "$2" ]; } # ROBOT SESSION

readers=(cyclone-reliable cyclone-best-effort fast-reliable fast-best-effort)
read_with() { # NAME PROGRAM MODE BASE...
  start "$1" "$build/tests/$2" "$work/$1" "${@:3}"
  until_true "$1 is ready" says "$1" ready
}
for mode in reliable best-effort; do
  read_with "cyclone-$mode" orbbuf-dds-reader "$mode" mono_1 ros_2/left ros_2/right inertial
  [ $mode = best-effort ] || reliable=${pids[-1]}
  read_with "fast-$mode" orbbuf-fast-dds-reader "$mode" mono_1 ros_2/left ros_2/right
done

# 500 frames, through a link that is cut and a server that is started anew.
serve server 127.0.0.1:0
capture mono-1 1 500 50 "$camera"
one=${pids[-1]}
until_true 'frames arrive' has_frames mono-1 100
nft add rule inet link input tcp dport "${address##*:}" drop
sleep 2 # the outage
nft flush chain inet link input
until_true 'frames arrive after the outage' has_frames mono-1 250
end_server
serve server-again "$address"
wait "$one" || fail "mono-1 ended with $?"
session=$(session_of mono-1)
has_all "$session" 500 || fail 'the server has not 500 frames'
frames=$(wc -l <"$session/times.txt")
for reader in "${readers[@]}"; do
  case $reader in
    *-reliable) until_true "$reader has all" received_all "$reader" mono_1 "$session" images ;;
  esac
  count=$(received "$reader" mono_1 "$session" images)
  echo "dds: $reader: $count of $frames frames, byte for byte, through an outage and a restart of the server"
  [ "$count" -ge 250 ] || fail "$reader: $count of $frames frames"
done
grep -q 'mono-1: ROS 2 allows .* publishing on /mono_1' "$work/server.log" || fail 'the changed name is not logged'

# Samples beside frames: each once, with its stamp and its values.
awk 'BEGIN { for (i = 0; i < 1000; ++i) printf "%.0f,%d,0.5,-1,0,%d,9.81\n", i * 5e6 + 1, i, -i }' >"$work/samples.csv"
capture inertial 7 100 50 "stream.imu0.path=$work/samples.csv"
wait "${pids[-1]}" || fail "inertial ended with $?"
session=$(session_of inertial)
samples=$(grep -vc '^#' "$session/imu0/data.csv")
has_samples() { # READER: as many, and the right values
  local time x name
  [ "$(find "$work/$1/inertial" -name '*.imu' | wc -l)" -eq "$samples" ] || return 1
  while IFS=, read -r time x _; do
    printf -v name '%d.%09d.imu' $((time / 1000000000)) $((time % 1000000000))
    [ "$(cat "$work/$1/inertial/$name")" = \
      "inertial $x.000000 0.500000 -1.000000 0.000000 $([ "$x" -eq 0 ] || echo -n -)$x.000000 9.810000 -1.000000" ] || return 1
  done < <(grep -v '^#' "$session/imu0/data.csv")
}
[ "$samples" -ge 300 ] || fail "only $samples samples"
until_true 'all samples' has_samples cyclone-reliable
echo "dds: inertial/imu0: $samples samples, each with its stamp and its values"

# Stereo, each image with its calibration and its pixels; a late reader gets the last calibration.
capture a 3 100 100 source.realtime=false
wait "${pids[-1]}"
capture b 4 100 100 source.realtime=false
wait "${pids[-1]}"
a=$(session_of a)
# 10 images a second: the 16 raw ones that the server keeps for a reader are 1.6 s.
start robot-2 "${robot[@]}" --set robot.id=2 --set "link.server=$address" --set "$camera" --set source.kind=folder \
  --set source.fps=10 --set "source.path=$a/images" --set "source.path_right=$(session_of b)/images"
wait "${pids[-1]}" || fail "2 ended with $?"
session=$(session_of 2)
[ "$(wc -l <"$session/times.txt")" -eq 100 ] || fail '2: not 100 frames'
has_calibration() { # READER BASE TX
  local time _
  while read -r _ time _; do
    [ "$(cat "$work/$1/$2/$time.info" 2>/dev/null)" = \
      "ros_2 160x120 plumb_bob 100.000000 101.000000 80.000000 60.000000 $3" ] || return 1
    [ "$(stat -c %s "$work/$1/$2/$time.raw" 2>/dev/null)" -eq $((160 * 120)) ] || return 1
  done <"$session/times.txt"
}
for side in 'left images 0.000000' 'right images_right -10.000000'; do
  read -r side folder tx <<<"$side"
  until_true "all $side images" received_all cyclone-reliable "ros_2/$side" "$session" "$folder"
  until_true "all $side images, Fast DDS" received_all fast-reliable "ros_2/$side" "$session" "$folder"
  until_true "all $side calibrations and raw images" has_calibration cyclone-reliable "ros_2/$side" "$tx"
  echo "dds: ros_2/$side: 100 frames, each with its stamp, its bytes, its calibration and its raw image"
done

# A late reader gets the last calibration, and no image, from a robot that sends nothing more.
capture c 6 100000 50 "$camera"
robot_c=${pids[-1]}
until_true 'frames arrive' has_frames c 50
kill -STOP "$robot_c"
read_with latched orbbuf-dds-reader latched c
until_true 'the late reader has a calibration' says latched 'receiving c .info'
kill -TERM "$robot_c"
kill -CONT "$robot_c"
wait "$robot_c" || fail "c ended with $?"
echo 'dds: a late reader got the last calibration'

# A reader that has stopped costs neither the robot, nor the files, nor another reader a frame.
session=$(session_of mono-1)
capture mono-1 5 300 50 source.width=1280
one=${pids[-1]}
until_true 'the session begins' has_another mono-1 "$session"
session=$(session_of mono-1)
until_true 'the reader has frames of it' received_some cyclone-reliable mono_1 "$session"
has_half() { [ "$(wc -l <"$session/times.txt")" -ge 150 ]; }
until_true 'half of the frames are there' has_half
! grep -q 'has missed' "$work"/server*.log || fail 'a reader that has all is said to have missed some'
kill -STOP "$reliable"
wait "$one" || fail "mono-1 ended with $?"
has_all "$session" 300 || fail 'a reader that has stopped has cost frames'
until_true 'the other reader has all' received_all fast-reliable mono_1 "$session" images
says server-again 'a reader of /mono_1/image_raw has missed [0-9]* messages' || fail 'what it missed is not logged'
kill -CONT "$reliable"
metrics >"$work/metrics.log"
grep -q 'orbbuf_unpublished_frames_total{robot="mono-1"} 0' "$work/metrics.log" || fail 'frames were not published'
echo "dds: a reader that stopped: $(wc -l <"$session/times.txt") of 300 frames recorded, and all of them at another reader"

# A robot whose own nodes get the frames as well: readers of both, through an outage, and beside a reliable one that stops.
for reader in cyclone fast stopped; do
  case $reader in fast) program=orbbuf-fast-dds-reader ;; *) program=orbbuf-dds-reader ;; esac
  read_with "kept-$reader" $program reliable robot/kept
done
stopped=${pids[-1]}
capture keeper 9 400 50 "${camera/0.1\\n/}" source.publish=/robot/kept
one=${pids[-1]}
until_true 'a node of the robot has a frame' says kept-stopped 'receiving robot/kept .jpg'
kill -STOP "$stopped"
nft add rule inet link input tcp dport "${address##*:}" drop
sleep 2 # the outage
nft flush chain inet link input
wait "$one" || fail "keeper ended with $?"
kill -CONT "$stopped"
session=$(session_of keeper)
has_all "$session" 400 || fail 'publishing on the robot has cost frames'
frames=$(wc -l <"$session/times.txt")
for reader in cyclone fast; do
  count=$(received "kept-$reader" robot/kept "$session" images)
  echo "dds: on the robot itself: $reader: $count of $frames frames, byte for byte"
  [ "$count" -ge $((frames / 2)) ] || fail "kept-$reader: $count of $frames frames" # without those before it was there
done
for info in "$work"/kept-cyclone/robot/kept/*.info; do
  [ "$(cat "$info")" = 'robot/kept 160x120 plumb_bob 100.000000 101.000000 80.000000 60.000000 0.000000' ] || fail "$info"
done

# The robot's own topics: a second robot reads what this server publishes, and sends it to a second server, through an
# outage. Each image arrives with its bytes and its stamp, and each sample once.
start relay-server "$build/server/orbbuf-server" --set listen.address=127.0.0.1:0 --set "files.path=$work/data-2"
until_true 'the second server listens' says relay-server 'listening on'
relay_address=$(sed -n 's/.*listening on //p' "$work/relay-server.log" | head -n 1)
start relay "${robot[@]}" --set robot.id=relay --set "link.server=$relay_address" --set source.kind=ros2 \
  --set source.topic=/origin/image_raw/compressed --set stream.imu0.kind=ros2 --set stream.imu0.topic=/origin/imu0
relay=${pids[-1]}
until_true 'the second robot is there' says relay-server 'relay'
# 200 samples a second, of the time of day.
awk -v begin="$(date +%s)" 'BEGIN { for (i = 0; i < 6000; ++i)
  printf "%d%03d000001,%d,0.5,-1,0,%d,0.1\n", begin + int(i / 200), i % 200 * 5, i, -i }' >"$work/samples.csv"
capture origin 8 500 50 "stream.imu0.path=$work/samples.csv"
origin=${pids[-1]}
until_true 'topics arrive' has_frames relay 100
nft add rule inet link input tcp dport "${relay_address##*:}" drop
sleep 2 # the outage
nft flush chain inet link input
wait "$origin" || fail "origin ended with $?"
session=$(session_of origin)
has_last() { grep -sqF "$(tail -n 1 "$session/times.txt" | cut -d' ' -f2)" "$work"/data-2/relay/*/{times.txt,drops.csv}; }
until_true 'the last image arrives, or was skipped' has_last
until_true 'the last sample arrives' grep -qF "$(tail -n 1 "$session/imu0/data.csv")" "$work"/data-2/relay/*/imu0/data.csv
kill -TERM "$relay"
wait "$relay" || fail "the second robot ended with $?"
copy=$(session_of relay)
# same_as_sent: each of its frames is one of the origin's; how many the origin has from its first one on.
same_as_sent() {
  awk -v from="$session" -v to="$copy" '
    NR == FNR { number[$2] = $1; order[$2] = ++sent; next }
    !($2 in number) { print "no such stamp: " $2 >"/dev/stderr"; exit 1 }
    FNR == 1 { first = order[$2] }
    { printf "cmp %s/images/%06d.jpg %s/images/%06d.jpg\n", from, number[$2], to, $1 | "sh -e >&2" }
    END { if (close("sh -e >&2") != 0) exit 1; print sent - first + 1 }' "$session/times.txt" "$copy/times.txt"
}
sent=$(same_as_sent) || fail 'the images of the second robot are not those of its topic'
frames=$(wc -l <"$copy/times.txt")
first=$(head -n 1 "$copy/times.txt" | cut -d' ' -f1)
skipped=0
[ ! -e "$copy/drops.csv" ] || skipped=$(awk -F, -v first="$first" '$1 + 0 > first' "$copy/drops.csv" | wc -l)
[ $((frames + skipped)) -eq "$sent" ] || fail "$frames images arrived and $skipped were skipped of $sent"
[ "$frames" -ge 400 ] || fail "only $frames images"
samples=$(grep -vc '^#' "$copy/imu0/data.csv")
tail -n "$samples" "$session/imu0/data.csv" | cmp - <(grep -v '^#' "$copy/imu0/data.csv") || fail 'the samples differ'
[ "$samples" -ge 1500 ] || fail "only $samples samples"
echo "dds: a robot's own topic: $samples samples, each once, with its stamp and its values"
echo "dds: a robot's own topic: $frames of $sent images, each with its stamp and its bytes, through an outage"

# The network of the readers goes, and the server still ends.
has_ended() { ! kill -0 "$1" 2>/dev/null; } # PID
ip link delete v0
kill -TERM "$server"
until_true 'the server ends without its network' has_ended "$server"
wait "$server" || fail "the server ended with $?"

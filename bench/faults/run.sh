#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# One fault at a time under a stream of 25 frames/s to a server with files and a recording, and then an
# account of every frame, from the source's bytes, the server's files, its recording, its drop record, the
# robot's own, and the robot's log. Usage: bench/faults/run.sh BUILD_FOLDER [FAULT...]; default: all of FAULTS
# RESULT faults.FAULT.{captured,delivered,lost,repeated,unexplained}, and faults.{run,lost,repeated,unexplained}.
# shellcheck disable=SC2317 # each fault is called by its name
set -euo pipefail
build=$(cd "$1" && pwd)
shift
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=bench/link/rig.sh
. bench/link/rig.sh
FAULTS='round_trip small_packets names reorder repeats flips slow_disk full_disk broken_disk two_servers killed_robot'
SECONDS_OF_FAULT=6
address=$ADDRESS_cubic # where the robot reaches the server
robot_words=()         # before orbbufd
disk=                  # the server's folder; empty: one of its own

# serve FAULT: the server, on the port that it had before if there was one.
serve() {
  served=$1
  start "$1-server" "${on_server[@]}" "$build/server/orbbuf-server" --set "listen.address=$address:${port:-0}" \
    --set listen.insecure=true --set "files.path=${disk:-$work/$1}" --set mcap.enabled=true
  wait_for "$1-server" 'listening on'
  port=$(grep -o 'listening on .*' "$work/$1-server.err" | grep -o '[0-9]*$')
}

# stream FAULT [SETTING...]: orbbufd, its log in $work/FAULT-robot.err, its record in $work/FAULT-drops.
stream() {
  local fault=$1 setting settings=()
  for setting in "${@:2}"; do settings+=(--set "$setting"); done
  start "$fault-robot" "${on_robot[@]}" "${robot_words[@]}" "$build/daemon/orbbufd" --set robot.id=r \
    --set "link.server=${robot_reaches:-$address}:$port" --set source.kind=folder --set "source.path=$work/images" \
    --set source.fps=25 --set source.loop=true --set 'link.drain_timeout=1 min' \
    --set "buffer.drop_log=$work/$fault-drops" "${settings[@]}"
  robot_pid=${pids[-1]}
  wait_for "$fault-robot" 'connected to'
}

# finish: the robot delivers what it has and ends, then the server.
finish() {
  kill -TERM "$robot_pid"
  wait "$robot_pid" || true # its log says why; the account shows what is missing
  stop_from 0
  port=
}

# account NAME LOG [--killed]: of the session that this log names.
account() {
  local name=$1 log=$2 session line what value
  session=$(grep -o ', session [^,]*' "$log" | head -n 1)
  session=${session#, session }
  line=$("$build/bench/orbbuf-audit" --session "${disk:-$work/$served}/r/$session" --log "$log" \
    --source "$work/images" "${@:3}") || failed=1
  say "$name: ${line//$'\n'/$'\n'  }"
  while read -r what value; do
    results+=("RESULT faults.$name.$what $value")
    total[$what]=$((${total[$what]:-0} + value))
  done < <(tail -n 1 <<<"$line" | xargs -n 2)
}

# over_path MS [REORDER REPEAT FLIP]: the stream of FAULT takes a way with these faults.
over_path() {
  local fault=$1 address=$ADDRESS_far
  lay_path "${@:2}"
  serve "$fault"
  stream "$fault"
  sleep "$SECONDS_OF_FAULT"
  [ "$fault" != flips ] || wait_for flips-server checksum
  finish
  account "$fault" "$work/$fault-robot.err"
}

round_trip() { over_path round_trip 600; }
reorder() { over_path reorder 20 0.2 0 0; }
repeats() { over_path repeats 20 0.1 0.2 0; }
flips() { over_path flips 20 0 0 0.005; }

# Packets over 1200 bytes vanish, and nothing says so.
small_packets() {
  local host
  serve small_packets
  stream small_packets
  for host in on_robot on_server; do
    local -n words=$host
    "${words[@]}" nft 'add table inet hole; add chain inet hole in { type filter hook input priority 0; }
      add rule inet hole in meta length > 1200 drop'
  done
  sleep "$SECONDS_OF_FAULT"
  for host in on_robot on_server; do
    local -n words=$host
    "${words[@]}" nft delete table inet hole
  done
  finish
  account small_packets "$work/small_packets-robot.err"
}

# The name server is behind the link that fails.
names() {
  local robot_reaches=slam
  printf 'nameserver %s\n' "$address" >"$work/resolv.conf"
  printf 'hosts: files dns\n' >"$work/nsswitch.conf"
  printf '%s slam\n' "$address" >"$work/hosts"
  # shellcheck disable=SC2016 # the inner shell's "$@"
  robot_words=(unshare --mount sh -c 'for file in resolv.conf nsswitch.conf hosts; do
      mount --bind "$0/$file" "/etc/$file" || exit
    done
    exec "$@"' "$work")
  serve names
  stream names
  robot_words=()
  : >"$work/hosts"
  cut_link
  sleep "$SECONDS_OF_FAULT"
  mend_link
  finish
  account names "$work/names-robot.err"
}

# with_disk FAULT MS ERROR: the server's files are on a disk like that; `fail` and `heal` change it.
with_disk() {
  if [ ! -x "$build/bench/orbbuf-bad-disk" ] || [ ! -c /dev/fuse ]; then
    say "bench: skipped: $1 (Debian: libfuse3-dev fuse3; and /dev/fuse)"
    return 1
  fi
  disk=$work/$1-mount
  mkdir "$disk" "$work/$1-disk"
  "$build/bench/orbbuf-bad-disk" "$work/$1-disk" "$disk" "$2" "$3" 2>"$work/$1-disk.err" &
  disk_pid=$!
  until mountpoint -q "$disk"; do kill -0 "$disk_pid" && sleep 0.05; done
}
without_disk() {
  umount "$disk"
  wait "$disk_pid" || true
  disk=
}

slow_disk() {
  with_disk slow_disk 20 full || return 0
  serve slow_disk
  stream slow_disk
  sleep "$SECONDS_OF_FAULT"
  finish
  account slow_disk "$work/slow_disk-robot.err"
  without_disk
}

full_disk() {
  with_disk full_disk 0 full || return 0
  serve full_disk
  stream full_disk
  sleep 2
  kill -USR1 "$disk_pid"
  wait_for full_disk-server 'stream paused'
  sleep 2
  kill -USR2 "$disk_pid"
  sleep 1
  finish
  account full_disk "$work/full_disk-robot.err"
  without_disk
}

# A sync fails: the server acknowledges nothing until it is started again.
broken_disk() {
  with_disk broken_disk 0 broken || return 0
  serve broken_disk
  local server=${pids[-1]}
  stream broken_disk
  sleep 2
  kill -USR1 "$disk_pid"
  wait_for broken_disk-server 'Input/output error'
  sleep 1
  kill -USR2 "$disk_pid"
  kill -TERM "$server"
  wait "$server" || true
  mv "$work/broken_disk-server.err" "$work/broken_disk-server-1.err"
  serve broken_disk
  sleep 2
  finish
  account broken_disk "$work/broken_disk-robot.err"
  without_disk
}

# A second server on the folder does not start, and the first goes on.
two_servers() {
  serve two_servers
  stream two_servers
  sleep 2
  if "${on_server[@]}" "$build/server/orbbuf-server" --set listen.address=127.0.0.1:0 \
    --set "files.path=$work/two_servers" >"$work/second.err" 2>&1; then
    say 'two_servers: the second one started'
    failed=1
  fi
  sleep 2
  finish
  account two_servers "$work/two_servers-robot.err"
}

# kill -9 while the link is down; the next start gives the server what it lacks of the record.
killed_robot() {
  serve killed_robot
  stream killed_robot buffer.capacity=25 buffer.policy=uniform
  sleep 2
  cut_link
  sleep 3
  kill -KILL "$robot_pid"
  wait "$robot_pid" || true
  cp "$work/killed_robot-robot.err" "$work/killed.log"
  mend_link
  stream killed_robot
  wait_for killed_robot-robot ': the server has its '
  sleep 2
  finish
  account killed_robot "$work/killed.log" --killed
  account killed_robot_next "$work/killed_robot-robot.err"
}

declare -A total=()
failed=0
port=
rig_up
make_images "$work/images" 250 320 240
faults=("$@")
[ $# -gt 0 ] || read -ra faults <<<"$FAULTS"
for fault in "${faults[@]}"; do
  [[ " $FAULTS " == *" $fault "* ]] || { say "bench: no fault $fault; there are: $FAULTS" && exit 2; }
  "$fault"
done
results+=("RESULT faults.run ${#faults[@]}")
for name in captured delivered lost repeated unexplained; do
  results+=("RESULT faults.$name ${total[$name]:-0}")
done
exit $failed

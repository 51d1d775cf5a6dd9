#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The topics of a TurtleBot3 but its camera, through a link that is cut and a server that publishes them again, beside
# generated frames, in a network namespace of its own. Each message that orbbufd captured is compared with what came
# behind the server: its bytes, and when it was written.
# Usage: bench/dds/topics.sh BUILD_FOLDER [--cut SECONDS] [--restart] [--writer PROGRAM]
#   --restart: the server, too, ends and begins again; --writer: in place of the one of Cyclone DDS
set -euo pipefail
if [ -z "${ORBBUF_OWN_NAMESPACE-}" ]; then
  ORBBUF_OWN_NAMESPACE=1 exec unshare --net --map-root-user "$0" "$@"
fi
build=$(cd "$1" && pwd)
shift
cut=2 is_restarted='' writer=$build/bench/orbbuf-dds-topic-writer
while [ $# -gt 0 ]; do
  case $1 in
    --cut) cut=$2 && shift ;;
    --writer) writer=$(realpath "$2") && shift ;;
    --restart) is_restarted=1 ;;
    *) echo "topics: unknown option $1" >&2 && exit 2 ;;
  esac
  shift
done
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-topics.XXXXXX")
logs=$work
pids=()
cleanup() {
  for pid in "${pids[@]}"; do kill -TERM "$pid" || true; done 2>/dev/null
  wait
  rm -rf "$work"
}
trap cleanup EXIT
fail() { echo "topics: $*" >&2 && tail -n 20 "$work"/{server,robot,writer}.log >&2 && exit 1; }

# shellcheck source=bench/dds/parts.sh
. "$(dirname "${BASH_SOURCE[0]}")/parts.sh"
lay_network
nft add table inet link
nft add chain inet link input '{ type filter hook input priority 0; }'

messages() { grep -s "^$2 " "$work/$1.log" || true; } # TAP NAME
has_written() { [ "$(messages source odom | wc -l)" -ge "$1" ]; }

topics=(odom tf scan tf_static)
start source "$build/bench/orbbuf-dds-topic-tap" '' volatile
start behind "$build/bench/orbbuf-dds-topic-tap" /robot_1 volatile
until_true 'the readers are there' says source ready
serve() { # NAME ADDRESS
  start "$1" "$build/server/orbbuf-server" --set "listen.address=$2" --set "files.path=$work/data" --set dds.enabled=true
  until_true 'the server listens' says "$1" 'listening on'
}
serve server 127.0.0.1:0
server=${pids[-1]}
address=$(sed -n 's/.*listening on //p' "$work/server.log" | head -n 1)
streams=()
for topic in "${topics[@]}"; do
  streams+=(--set "stream.$topic.kind=topic" --set "stream.$topic.topic=/$topic")
done
start robot "$build/daemon/orbbufd" --set robot.id=robot-1 --set "link.server=$address" --set source.kind=generated \
  --set source.width=320 --set source.height=240 --set source.fps=15 --set source.frames=100000 \
  "${streams[@]}"
robot=${pids[-1]}
until_true 'the robot is there' says server robot-1
start writer "$writer" $((cut + 8)) 2 # readers: the tap and orbbufd
until_true 'messages are written' has_written 60
nft add rule inet link input tcp dport "${address##*:}" drop
sleep "$cut"
nft flush chain inet link input
if [ -n "$is_restarted" ]; then
  kill -TERM "$server"
  wait "$server" || fail "the server ended with $?"
  serve server-again "$address"
fi
until_true 'all is written' says writer '^done'
same() { # NAME: as many came behind as were written
  [ "$(messages behind "$1" | wc -l)" -ge "$(awk -v name="$1" '$1 == name { n += $2 } END { print n }' "$work/writer.log")" ]
}
SECONDS=0
for topic in "${topics[@]}"; do
  until same "$topic" || [ $SECONDS -gt 20 ]; do sleep 0.05; done
done
start late "$build/bench/orbbuf-dds-topic-tap" /robot_1 latched
has_latched() { [ "$(messages late tf_static | wc -l)" -ge 2 ]; }
until_true 'a late reader has /tf_static of both publishers' has_latched
kill -TERM "$robot"
wait "$robot" || fail "the robot ended with $?"
session=$(echo "$work"/data/robot-1/*)
has_ended() { [ -e "$session/session.txt" ]; }
until_true 'the session has ended' has_ended

status=0
for topic in "${topics[@]}"; do
  messages source "$topic" | sort >"$work/written"
  messages behind "$topic" | sort >"$work/came"
  read -r _ _ kept _ named <<<"$(grep "^$topic delivered" "$session/session.txt")"
  captured=$((kept + named))
  written=$(awk -v name="$topic" '$1 == name { n += $2 } END { print n }' "$work/writer.log")
  delivered=$(comm -12 <(uniq "$work/written") <(uniq "$work/came") | wc -l)
  lost=$((written - delivered - named))
  repeated=$(($(wc -l <"$work/came") - $(uniq "$work/came" | wc -l)))
  [ "$topic" = tf_static ] || for result in captured delivered lost repeated; do
    echo "RESULT dds.$topic.$result ${!result}"
  done
  echo "topics: $topic: $written written, $captured captured, $delivered came with their bytes and times, $named named lost"
  [ -z "$is_restarted" ] || [ "$topic" != tf_static ] || repeated=0 # by the second server
  [ "$captured" -eq "$written" ] && [ "$lost" -eq 0 ] && [ "$repeated" -eq 0 ] && [ "$named" -eq 0 ] || status=1
  [ "$(tail -n +2 "$session/topics/$topic.csv" | wc -l)" -eq "$kept" ] || fail "topics/$topic.csv has not $kept lines"
  publishers() { grep -s "^publisher $topic " "$work/$1.log" | sort -u; }
  [ "$(publishers source)" = "$(publishers behind)" ] || fail "$topic: $(publishers behind), not $(publishers source)"
done
echo "RESULT dds.late_behind_frame $("$build/server/orbbuf-server" check "$session" |
  awk '/came behind a newer frame/ { n += $3 } END { print n + 0 }')"
[ $status -eq 0 ]

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The demo: 20 s of a generated scene, the link cut for 3 s in the middle, once under drop-oldest, once
# under orbbuf and once under catch-up. Real processes over real TCP: between two network namespaces with an nftables
# drop on the receiving side where that is possible (root), else with the server stopped, so that it
# reads nothing. Usage: bench/demo.sh BUILD_FOLDER
set -euo pipefail
build=$(cd "$1" && pwd)
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-demo.XXXXXX")
robot_ns=orbbuf-robot-$$
server_ns=orbbuf-server-$$
pids=()
FRAMES=500 FPS=25 OUTAGE_BEGIN=8.5 OUTAGE_END=11.5

finish() {
  for pid in "${pids[@]}"; do
    if kill "$pid" 2>/dev/null; then kill -CONT "$pid"; fi
  done
  ip netns del "$robot_ns" 2>/dev/null || true
  ip netns del "$server_ns" 2>/dev/null || true
}
trap finish EXIT

make_namespaces() {
  [ "$(id -u)" -eq 0 ] || return 1
  {
    ip netns add "$robot_ns" && ip netns add "$server_ns" &&
      ip -n "$robot_ns" link add robot type veth peer name server netns "$server_ns" &&
      ip -n "$robot_ns" addr add 10.77.0.1/24 dev robot && ip -n "$robot_ns" link set robot up &&
      ip -n "$server_ns" addr add 10.77.0.2/24 dev server && ip -n "$server_ns" link set server up &&
      ip netns exec "$server_ns" nft list ruleset
  } >/dev/null 2>&1
}

if make_namespaces; then
  on_robot=(ip netns exec "$robot_ns") on_server=(ip netns exec "$server_ns") address=10.77.0.2
  link_down() {
    "${on_server[@]}" nft 'add table inet demo; add chain inet demo in { type filter hook input priority 0; policy drop; }'
  }
  link_up() { "${on_server[@]}" nft delete table inet demo; }
  how='every packet to the server dropped (nftables, network namespaces)'
else
  on_robot=() on_server=() address=127.0.0.1
  link_down() { kill -STOP "$server_pid"; }
  link_up() { kill -CONT "$server_pid"; }
  how='the server stopped, so that it reads nothing (no root, or no network namespaces here)'
fi

say_progress() { # POLICY SECONDS LINK
  local line
  line=$(grep -o 'captured [0-9].*' "$work/robot-$1.log" 2>/dev/null | tail -n 1 || true)
  line=$(printf '%-12s %5.1f s  link %-4s  %s' "$1" "$2" "$3" "$line")
  if [ -t 1 ]; then
    printf '\r%-118.118s' "$line"
  elif [[ $2 == *.0 ]]; then
    echo "$line"
  fi
}

since() { awk -v a="$1" -v b="$(date +%s.%N)" 'BEGIN { printf "%.1f", b - a }'; }
reached() { awk -v a="$1" -v b="$2" 'BEGIN { exit !(a >= b) }'; }

run() { # POLICY
  local policy=$1 link=up start now port
  "${on_server[@]}" "$build/server/orbbuf-server" --set "listen.address=$address:0" \
    --set listen.insecure=true --set "files.path=$work/$policy" 2>"$work/server-$policy.log" &
  server_pid=$! && pids+=("$server_pid")
  until port=$(grep -o "listening on .*" "$work/server-$policy.log" | grep -o '[0-9]*$'); do
    kill -0 "$server_pid" 2>/dev/null || { cat "$work/server-$policy.log" && exit 1; }
    sleep 0.05
  done
  "${on_robot[@]}" "$build/daemon/orbbufd" --set robot.id=demo --set "link.server=$address:$port" \
    --set "source.frames=$FRAMES" --set "source.fps=$FPS" --set "buffer.policy=$policy" \
    2>"$work/robot-$policy.log" &
  local robot_pid=$! && pids+=("$robot_pid")
  until grep -q 'source: ' "$work/robot-$policy.log"; do # capture time begins here
    kill -0 "$robot_pid" 2>/dev/null || { cat "$work/robot-$policy.log" && exit 1; }
    sleep 0.02
  done
  start=$(date +%s.%N)
  while kill -0 "$robot_pid" 2>/dev/null; do
    now=$(since "$start")
    if [ $link = up ] && reached "$now" $OUTAGE_BEGIN && ! reached "$now" $OUTAGE_END; then
      link_down && link=down
    elif [ $link = down ] && reached "$now" $OUTAGE_END; then
      link_up && link=up
    fi
    say_progress "$policy" "$now" $link
    sleep 0.1
  done
  [ -t 1 ] && echo
  wait "$robot_pid" || { cat "$work/robot-$policy.log" && exit 1; }
  kill "$server_pid" && wait "$server_pid"
  grep -E 'link:|session ended' "$work/robot-$policy.log" | sed 's/^[^ ]* /  /'
  "$build/server/orbbuf-server" check "$work/$policy"/demo/* | sed 's/^[^ ]* /  /'
}

echo "demo: $FRAMES generated frames at $FPS fps; drop-oldest and orbbuf with a buffer of 25 frames; link down from $OUTAGE_BEGIN s to $OUTAGE_END s:"
echo "      $how"
for policy in drop-oldest orbbuf catch-up; do run "$policy"; done
echo
"$build/bench/orbbuf-timeline" drop-oldest="$(echo "$work"/drop-oldest/demo/*)" \
  orbbuf="$(echo "$work"/orbbuf/demo/*)" catch-up="$(echo "$work"/catch-up/demo/*)" --png "$work/timeline.png" --outage-begin $OUTAGE_BEGIN \
  --outage-end $OUTAGE_END --results demo

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced after rig.sh: a robot that knows two servers, of which the one that has the stream is killed
# (its host refuses connections then), or cut off (nothing answers): how soon a frame is at the other.
SERVER_PORTS=(7801 7802)

# start_server NUMBER
start_server() {
  local settings=() setting
  for setting in "${server_settings[@]}"; do settings+=(--set "$setting"); done
  start "server-$1" "${on_server[@]}" "$build/server/orbbuf-server" --set listen.insecure=true \
    --set "listen.address=$ADDRESS_cubic:${SERVER_PORTS[$1]}" --set "files.path=$work/server-$1" "${settings[@]}"
  server_pids[$1]=${pids[-1]}
  wait_for "server-$1" 'listening on'
}

# first_frame_after TIME NUMBER: when the first frame that came after TIME was on that server's disk.
first_frame_after() {
  find "$work/server-$2" -path '*/images/*.jpg' -newermt "@$1" -printf '%T@\n' | sort -n | head -n 1
}

# lose KILLED|CUT NUMBER: the seconds until a frame is at the other server.
lose() {
  local begin=$EPOCHREALTIME first='' tries=0 other=$((1 - $2))
  case $1 in
    killed) { kill -KILL "${server_pids[$2]}" && wait "${server_pids[$2]}"; } 2>/dev/null || true ;;
    cut) "${on_server[@]}" nft "add table inet cut
      add chain inet cut in { type filter hook input priority 0; }
      add rule inet cut in tcp dport ${SERVER_PORTS[$2]} drop" ;;
  esac
  until [ -n "$first" ] || [ $((tries++)) -gt 100 ]; do
    sleep 0.1
    first=$(first_frame_after "$begin" "$other")
  done
  awk -v b="$begin" -v f="${first:-nan}" 'BEGIN { printf "%.3f\n", f - b }'
  case $1 in
    killed) start_server "$2" ;;
    cut) mend_link ;;
  esac
}

lost_servers() { # REPEATS
  local how i seconds median worst server_pids=()
  make_images "$work/server-images" 250 320 240
  shape 20
  start_server 0
  start_server 1
  start servers-robot "${on_robot[@]}" "$build/daemon/orbbufd" --set robot.id=r --set source.kind=folder \
    --set "link.server=[\"$ADDRESS_cubic:${SERVER_PORTS[0]}\", \"$ADDRESS_cubic:${SERVER_PORTS[1]}\"]" \
    --set "source.path=$work/server-images" --set "source.fps=$FPS" --set source.loop=true
  wait_for servers-robot 'connected to'
  for how in killed cut; do
    : >"$work/lost-$how"
    for ((i = 0; i < $1; ++i)); do
      sleep "$(awk -v r="$RANDOM" 'BEGIN { printf "%.3f", 2 + r / 32768 }')"
      lose "$how" $((i % 2)) >>"$work/lost-$how"
      seconds=$(tail -n 1 "$work/lost-$how")
      printf '  server %-8s a frame at the other after %6.3f s\n' "$how" "$seconds"
    done
    [ $(($1 % 2)) -eq 0 ] || lose killed $((i % 2)) >/dev/null # the first has the stream again
    read -r median worst < <(sort -n "$work/lost-$how" |
      awk '{ v[NR] = $1 } END { printf "%.3f %.3f\n", (v[int((NR + 1) / 2)] + v[int(NR / 2) + 1]) / 2, v[NR] }')
    results+=("RESULT link.server_${how}_median_s $median" "RESULT link.server_${how}_worst_s $worst")
  done
  stop_from 0
}

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced: two hosts, each a network namespace, with a cable between them whose rate is shaped
# at the robot and whose packets are lost at the server. The server host has an address for each
# congestion control: what the robot sends to it is under that one. Wants `build`, makes `work`.
ADDRESS_cubic=10.77.0.2
ADDRESS_bbr=10.77.0.3
ADDRESS_far=10.78.0.2 # over lay_path

rig=$(dirname "${BASH_SOURCE[0]}")
robot_ns=orbbuf-robot-$$
server_ns=orbbuf-server-$$
modem_ns=orbbuf-modem-$$ # of lay_modem
on_robot=(ip netns exec "$robot_ns")
on_server=(ip netns exec "$server_ns")
pids=()
server_settings=()
results=() # RESULT lines, to be printed at the end
work=

say() { printf '%s\n' "$*" >&2; }

rig_down() {
  local pid
  [ ${#results[@]} -eq 0 ] || printf '%s\n' "${results[@]}" # also those before a failure
  for pid in "${pids[@]}"; do kill "$pid" 2>/dev/null || true; done
  [ ${#pids[@]} -eq 0 ] || wait "${pids[@]}" 2>/dev/null || true
  ip netns del "$robot_ns" 2>/dev/null || true
  ip netns del "$server_ns" 2>/dev/null || true
  ip netns del "$modem_ns" 2>/dev/null || true
  [ -z "$work" ] || rm -rf "$work"
}

# lay_cable: gives each host its end of a cable, `wire`.
lay_cable() { ip -n "$robot_ns" link add wire type veth peer name wire netns "$server_ns"; }

rig_up() {
  trap rig_down EXIT
  trap "exit 143" TERM # so that it is run at a safe place
  work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-link.XXXXXX")
  {
    ip netns add "$robot_ns" && ip netns add "$server_ns" &&
      lay_cable &&
      ip -n "$robot_ns" addr add 10.77.0.1/24 dev wire &&
      ip -n "$server_ns" addr add "$ADDRESS_cubic/24" dev wire &&
      ip -n "$server_ns" addr add "$ADDRESS_bbr/24" dev wire &&
      ip -n "$robot_ns" link set lo up && ip -n "$server_ns" link set lo up &&
      ip -n "$robot_ns" link set wire up && ip -n "$server_ns" link set wire up &&
      "${on_server[@]}" nft list ruleset
  } >/dev/null 2>"$work/rig.log" ||
    { say "bench: no network namespaces, or no link between them, here (not root?): $(cat "$work/rig.log")" && exit 77; }
  controls=()
  local control address
  for control in cubic bbr; do
    address=ADDRESS_$control
    if ip -n "$robot_ns" route add "${!address}/32" dev wire congctl "$control" 2>/dev/null; then
      controls+=("$control")
    else
      say "bench: skipped: congestion control $control, which this kernel does not have"
    fi
  done
}

# shape MBIT: what the robot can send from now on; up to 100 ms wait in the link itself.
shape() {
  tc -n "$robot_ns" qdisc replace dev wire root tbf rate "$1mbit" burst 32kb latency 100ms
}

cut_link() {
  "${on_server[@]}" nft \
    'add table inet cut; add chain inet cut in { type filter hook input priority 0; policy drop; }'
}
mend_link() { "${on_server[@]}" nft delete table inet cut; }

# start NAME COMMAND...: in the background; its output is $work/NAME.out, its words $work/NAME.err.
start() {
  local name=$1
  shift
  : >"$work/$name.out" # what an earlier one of this name has said
  : >"$work/$name.err"
  "$@" >"$work/$name.out" 2>"$work/$name.err" &
  pids+=($!)
}

# wait_for NAME PATTERN: until NAME has said so.
wait_for() {
  local tries=0
  until grep -q "$2" "$work/$1.out" "$work/$1.err" 2>/dev/null; do
    [ $((tries++)) -lt 200 ] || {
      say "bench: $1 never said \"$2\":"
      cat "$work/$1.err" >&2
      exit 1
    }
    sleep 0.05
  done
}

# Stops what was started since `pids` had FIRST entries.
stop_from() { # FIRST
  local stopped=("${pids[@]:$1}")
  pids=("${pids[@]:0:$1}")
  [ ${#stopped[@]} -eq 0 ] || kill "${stopped[@]}" 2>/dev/null || true
  wait "${stopped[@]}" 2>/dev/null || true
}

# lay_path MS [...]: a second way between the hosts, with this round trip, and what else `orbbuf-link-peer path`
# takes. Until stop_from.
lay_path() {
  start path "${on_robot[@]}" "$build/bench/orbbuf-link-peer" path near far \
    "$(awk -v ms="$1" 'BEGIN { print ms / 2000 }')" "${@:2}"
  wait_for path 'path from'
  ip -n "$robot_ns" link set far netns "$server_ns"
  ip -n "$robot_ns" addr add 10.78.0.1/24 dev near
  ip -n "$server_ns" addr add "$ADDRESS_far/24" dev far
  ip -n "$robot_ns" link set near up
  ip -n "$server_ns" link set far up
}

# make_images FOLDER COUNT WIDTH HEIGHT [OPTION...]: COUNT generated JPEGs, to be replayed as a camera's; with these
# options of orbbufd.
make_images() {
  local first=${#pids[@]} port
  start images-server "${on_server[@]}" "$build/server/orbbuf-server" \
    --set listen.address=127.0.0.1:0 --set "files.path=$work/made"
  wait_for images-server 'listening on'
  port=$(grep -o 'listening on .*' "$work/images-server.err" | grep -o '[0-9]*$')
  "${on_server[@]}" "$build/daemon/orbbufd" --set robot.id=images \
    --set "link.server=127.0.0.1:$port" --set source.realtime=false \
    --set "source.frames=$2" --set "source.width=$3" \
    --set "source.height=$4" "${@:5}" 2>"$work/images.err"
  stop_from "$first"
  mv "$work"/made/images/*/images "$1"
  rm -r "$work/made"
}

# chosen NAME: the lines TIME NUMBER of the frames that orbbufd has chosen to send, from its log.
chosen() {
  TZ=UTC awk '/ is the kernel/ {
    gsub(/[-T:Z.]/, " ", $1)
    split($1, t, " ")
    at = mktime(t[1] " " t[2] " " t[3] " " t[4] " " t[5] " " t[6]) + t[7] / 1000
    for (i = 2; i < NF; ++i) if ($i == "frame") printf "%.3f %d\n", at, $(i + 1)
  }' "$work/$1-robot.err"
}

# make_keys NAMES: of the server, under these names and addresses, and of the robot; what start_stream is
# to use of them is in `server_settings` and `stream_settings`.
make_keys() {
  local keys name
  keys=$(mktemp -d "$work/keys.XXXXXX")
  for name in ca server robot; do
    awk -v name="sh $name" '/^```/ { on = substr($0, 4) == name; next } on' "$rig/../../docs/security.md"
  done | sed "s/DNS:localhost,IP:127.0.0.1/$1/" >"$keys/make.sh"
  (cd "$keys" && sh -e make.sh) >"$keys/log" 2>&1 || { cat "$keys/log" >&2 && exit 1; }
  server_settings=("tls.certificate=$keys/server.crt" "tls.key=$keys/server.key" "tls.ca=$keys/ca.crt")
  # shellcheck disable=SC2034 # flow.sh has none
  stream_settings=(robot.id=turtlebot1 "tls.certificate=$keys/turtlebot1.crt"
    "tls.key=$keys/turtlebot1.key" "tls.ca=$keys/ca.crt")
}

# start_stream NAME ADDRESS IMAGES FPS [SETTING...]: orbbuf-server with `server_settings`, orbbufd with
# these settings, which reaches it by `robot_reaches` if that is set, and a watch on what arrives, whose lines TIME BYTES FILE are $work/NAME.out.
start_stream() {
  local name=$1 address=$2 images=$3 fps=$4 port folder setting settings=() on_server_only=() tries
  for setting in "${@:5}"; do settings+=(--set "$setting"); done
  for setting in "${server_settings[@]}"; do on_server_only+=(--set "$setting"); done
  start "$name-server" "${on_server[@]}" "$build/server/orbbuf-server" \
    --set "listen.address=$address:0" --set listen.insecure=true \
    --set "files.path=$work/$name" "${on_server_only[@]}"
  wait_for "$name-server" 'listening on'
  port=$(grep -o 'listening on .*' "$work/$name-server.err" | grep -o '[0-9]*$')
  start "$name-robot" "${on_robot[@]}" "$build/daemon/orbbufd" --set robot.id=r \
    --set "link.server=${robot_reaches:-$address}:$port" --set source.kind=folder --set "source.path=$images" \
    --set "source.fps=$fps" --set source.loop=true --set 'link.drain_timeout=100 ms' \
    "${settings[@]}"
  wait_for "$name-robot" 'connected to'
  for ((tries = 0; tries < 200; ++tries)); do
    folder=$(echo "$work/$name"/*/*/images)
    [ -d "$folder" ] && break
    sleep 0.05
  done
  start "$name" "$build/bench/orbbuf-link-peer" watch "$folder"
}

# start_ros PROGRAM: its `receive`, and the master, on the server; the words that run it on the robot
# are in `ros_on_robot`. False, and said so, where ROS or the program is not installed.
start_ros() {
  if ! command -v rosmaster >/dev/null || [ ! -x "$1" ]; then
    say 'bench: skipped: roscpp (Debian: libroscpp-dev libsensor-msgs-dev python3-rosmaster)'
    return 1
  fi
  local ros=(env "ROS_MASTER_URI=http://$ADDRESS_cubic:11311" "ROS_LOG_DIR=$work/ros"
    "ROS_HOME=$work/ros")
  local ros_on_server=("${on_server[@]}" "${ros[@]}" "ROS_IP=$ADDRESS_cubic")
  # shellcheck disable=SC2034 # faults/run.sh has no ROS
  ros_on_robot=("${on_robot[@]}" "${ros[@]}" ROS_IP=10.77.0.1)
  start rosmaster "${ros_on_server[@]}" rosmaster --core -p 11311
  sleep 2
  start roscpp "${ros_on_server[@]}" "$1" receive
}

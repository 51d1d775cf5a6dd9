#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# One rival's link, between two network namespaces of its own: 20 Mbit/s, 10 ms of round trip, a queue of 100 ms at the
# robot. lane.sh BUILD NAME [ARGUMENT...]: lane.py measures NAME over it; lane.sh BUILD images FOLDER COUNT: makes the
# camera's images.
set -euo pipefail
build=$1
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=bench/link/rig.sh
. "$here/../link/rig.sh"
rig_up
if [ "$2" = images ]; then
  make_images "$3" "$4" 528 400 --set jpeg.color=true # 40 kB each, as RTP takes them
  exit
fi
lay_path 10
ip -n "$robot_ns" link del wire # no way round the path
ip -n "$robot_ns" route replace 10.78.0.0/24 dev near congctl cubic
tc -n "$robot_ns" qdisc replace dev near root tbf rate 20mbit burst 32kb latency 100ms
server_settings=() stream_settings=()
[ "$2" != orbbuf_tls ] || make_keys "IP:$ADDRESS_far"
export PYTHONDONTWRITEBYTECODE=1 # of the peers
export RIVAL_ROBOT_NS=$robot_ns RIVAL_SERVER_NS=$server_ns RIVAL_WORK=$work
export RIVAL_TLS_SERVER="${server_settings[*]/#/--set }" RIVAL_TLS_ROBOT="${stream_settings[*]/#/--set }"
/usr/bin/python3 "$here/lane.py" "$@" &
lane=$!
trap 'kill $lane 2>/dev/null || true; wait $lane || true; rig_down' EXIT
wait $lane
trap rig_down EXIT

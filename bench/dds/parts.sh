# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced first, with the script's arguments: runs it again in a network namespace of its own. A folder for the run,
# a network for DDS, programs in the background, waiting for what they say.

if [ -z "${ORBBUF_OWN_NAMESPACE-}" ]; then
  root=()
  [ "$(id -u)" -eq 0 ] || root=(--map-root-user)
  ORBBUF_OWN_NAMESPACE=1 exec unshare --net --mount "${root[@]}" "$0" "$@"
fi
mount -t tmpfs tmpfs /dev/shm # Fast DDS aborts if another version of it has left files there

work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-dds.XXXXXX")
logs=$work # of what the programs say
pids=()    # of those in the background
cleanup() {
  for pid in "${pids[@]}"; do kill -TERM "$pid" || true; kill -CONT "$pid" || true; done 2>/dev/null
  wait
  rm -rf "$work"
}
trap cleanup EXIT
fail() { echo "${0##*/}: $*" >&2 && tail -n 20 "$logs"/*.log >&2 && exit 1; }

# lay_network: DDS finds its peers by multicast on v0; the robot's link is on lo, in the table `link` of nftables.
lay_network() {
  ip link set lo up
  ip link add v0 type veth peer name v1
  ip address add 10.99.0.1/24 dev v0
  ip link set v0 up
  ip link set v1 up
  nft add table inet link
  nft add chain inet link input '{ type filter hook input priority 0; }'
  export ROS_DOMAIN_ID=0
}

start() { # NAME COMMAND...
  "${@:2}" >"$logs/$1.log" 2>&1 &
  pids+=("$!")
}
until_true() { # WHAT COMMAND...
  SECONDS=0
  until "${@:2}"; do
    [ $SECONDS -lt 60 ] || fail "not within a minute: $1"
    sleep 0.05
  done
}
says() { grep -sq -- "$2" "$logs/$1.log"; } # NAME TEXT

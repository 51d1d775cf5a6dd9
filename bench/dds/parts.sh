# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced in a network namespace of one's own: a network for DDS, programs in the background, waiting for what they
# say. Wants `fail`, and `logs`, the folder of what the programs say; adds to `pids`.

# lay_network: DDS finds its peers by multicast on v0; the robot's link is on lo.
lay_network() {
  ip link set lo up
  ip link add v0 type veth peer name v1
  ip address add 10.99.0.1/24 dev v0
  ip link set v0 up
  ip link set v1 up
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

# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced after return.sh: two links between the hosts, of which the one that carries the stream
# fails: how long nothing arrives, and how many frames in a row never do. Beside orbbufd a camera over
# one connection of Multipath TCP, which has a subflow on each link.
ADDRESS_both=10.79.0.2
SETTLE_SECONDS=10 # after it carried nothing, a link is the stream's again: link.return_after and more

# lay_second_link: a cable of the same rate, and an address that both links reach, the first one by
# default. `wire` and `wire2`.
lay_second_link() {
  ip -n "$robot_ns" link add wire2 type veth peer name wire2 netns "$server_ns"
  ip -n "$robot_ns" addr add 10.80.0.1/24 dev wire2
  ip -n "$server_ns" addr add 10.80.0.2/24 dev wire2
  ip -n "$robot_ns" link set wire2 up
  ip -n "$server_ns" link set wire2 up
  ip -n "$server_ns" addr add "$ADDRESS_both/32" dev lo
  ip -n "$robot_ns" route add "$ADDRESS_both" via "$ADDRESS_cubic" metric 1
  ip -n "$robot_ns" route add "$ADDRESS_both" via 10.80.0.2 metric 2
  shape 20
  tc -n "$robot_ns" qdisc replace dev wire2 root tbf rate 20mbit burst 32kb latency 100ms
}

cut_one() { # LINK
  "${on_server[@]}" nft "add table inet cut-$1
    add chain inet cut-$1 in { type filter hook input priority 0; }
    add rule inet cut-$1 in iifname $1 drop"
}
mend_one() { "${on_server[@]}" nft delete table inet "cut-$1"; }

# longest_wait FLOW FROM TO: the longest time without a frame.
longest_wait() {
  awk -v from="$2" -v to="$3" '$1 >= from && $1 <= to { if (last && $1 - last > most) most = $1 - last }
    { last = $1 } END { printf "%.3f\n", (last < to && to - last > most) ? to - last : most }' "$work/$1.out"
}

# fail_over CUT MEND: CUT fails and, if it is given, MEND is back; for each flow a line of seconds in
# $work/failovers-FLOW.
fail_over() {
  local begin flow
  begin=$EPOCHREALTIME
  [ -z "$2" ] || mend_one "$2"
  cut_one "$1"
  sleep "$(awk -v r="$RANDOM" 'BEGIN { printf "%.3f", 5 + r / 32768 }')"
  for flow in "${flows[@]}"; do
    longest_wait "$flow" "$begin" "$EPOCHREALTIME" | tee -a "$work/failovers-$flow" |
      awk -v c="$1" -v f="$flow" '{ printf "  %-5s cut  %-8s nothing for %6.3f s\n", c, f, $1 }'
  done
}

# start_multipath: false, and said so, where the kernel or iproute2 has no Multipath TCP.
start_multipath() {
  if [ "$("${on_server[@]}" sysctl -n net.mptcp.enabled 2>/dev/null)" != 1 ] ||
    ! ip -n "$robot_ns" mptcp endpoint add 10.80.0.1 dev wire2 subflow 2>/dev/null; then
    say 'bench: skipped: Multipath TCP, which this kernel or iproute2 does not have'
    return 1
  fi
  start mptcp "${on_server[@]}" "$build/bench/orbbuf-link-peer" receive "$ADDRESS_both" 5002 mptcp
  wait_for mptcp listening
  start mptcp-send "${on_robot[@]}" "$build/bench/orbbuf-link-peer" send "$ADDRESS_both" 5002 \
    $IMAGE_BYTES $FPS mptcp
  flows+=(mptcp)
}

# longest_gap FLOW: in frames, by the names of the files.
longest_gap() {
  awk '{ sub(/\..*/, "", $3); print $3 + 0 }' "$work/$1.out" | sort -n |
    awk 'NR > 1 && $1 - last - 1 > most { most = $1 - last - 1 } { last = $1 } END { print most + 0 }'
}

failovers() { # CYCLES
  local cycle median worst flow name
  lay_second_link
  make_images "$work/two-images" 250 320 240
  start_stream two "$ADDRESS_both" "$work/two-images" $FPS 'link.interfaces=["wire", "wire2"]'
  flows=(two)
  start_multipath || true
  sleep 3
  for ((cycle = 0; cycle < $1; ++cycle)); do
    fail_over wire ''
    fail_over wire2 wire # before the stream is back on the first
    mend_one wire2
    sleep $SETTLE_SECONDS
  done
  stop_from 0
  for flow in "${flows[@]}"; do
    read -r median worst < <(sort -n "$work/failovers-$flow" |
      awk '{ v[NR] = $1 } END { printf "%.3f %.3f\n", (v[int((NR + 1) / 2)] + v[int(NR / 2) + 1]) / 2, v[NR] }')
    name=link.$flow
    [ "$flow" = two ] && name="link"
    results+=("RESULT $name.failover_median_s $median" "RESULT $name.failover_worst_s $worst")
  done
  results+=("RESULT link.failover_gap_frames $(longest_gap two)")
}

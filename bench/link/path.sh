# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced after return.sh: how soon frames come after an outage of a link with a long round trip,
# how long a robot needs to connect over it, what a name server behind the outage changes, for the end
# of the program too, and what the attempts to connect cost.
COST_SECONDS=20

# connect_seconds NAME: from the start of orbbufd to its connection, by its log.
connect_seconds() {
  TZ=UTC awk '/, session / || /connected to/ {
    gsub(/[-T:Z.]/, " ", $1)
    split($1, t, " ")
    at = mktime(t[1] " " t[2] " " t[3] " " t[4] " " t[5] " " t[6]) + t[7] / 1000
    if (!begin) begin = at; else { printf "%.3f\n", at - begin; exit }
  }' "$work/$1-robot.err"
}

# Plain TCP and TLS side by side: the path has room for both.
paths() { # OUTAGE:REPEATS...
  local ms first plan repeat name=link.round_trip
  local plain_server=("${server_settings[@]}") server_settings stream_settings
  make_images "$work/path-images" 250 320 240
  make_keys "IP:$ADDRESS_far"
  local tls_server=("${server_settings[@]}")
  for ms in "${round_trips[@]}"; do
    first=${#pids[@]}
    lay_path "$ms"
    server_settings=("${plain_server[@]}")
    start_stream "path-$ms" "$ADDRESS_far" "$work/path-images" 25
    server_settings=("${tls_server[@]}")
    start_stream "path-$ms-tls" "$ADDRESS_far" "$work/path-images" 25 "${stream_settings[@]}"
    results+=("RESULT ${name}_$ms.connect_s $(connect_seconds "path-$ms")"
      "RESULT ${name}_$ms.tls_connect_s $(connect_seconds "path-$ms-tls")")
    flows=("path-$ms" "path-$ms-tls")
    sleep 10 # slow start is over
    for plan in "$@"; do
      for ((repeat = 0; repeat < ${plan#*:}; ++repeat)); do outage "${plan%:*}"; done
    done
    conclude "path-$ms" "${name}_$ms" "$@"
    conclude "path-$ms-tls" "${name}_$ms.tls" "$@"
    stop_from "$first"
  done
}

# The name is known from the robot's table of hosts, with addresses of both families of which one works;
# then only the name server behind the link has it.
names() { # REPEATS
  local first=${#pids[@]} repeat median worst robot_reaches=slam
  local plain_on_robot=("${on_robot[@]}") on_robot
  printf 'nameserver %s\n' "$ADDRESS_cubic" >"$work/resolv.conf"
  printf 'hosts: files dns\n' >"$work/nsswitch.conf"
  ip -n "$robot_ns" addr add fd77::1/64 dev wire nodad 2>/dev/null ||
    say 'bench: skipped: IPv6 addresses of the name, which this kernel does not have'
  printf '%s slam\n' fd77::9 10.77.0.9 "$ADDRESS_cubic" >"$work/hosts"
  # shellcheck disable=SC2016 # the inner shell's "$@"
  on_robot=(unshare --mount sh -c 'for file in resolv.conf nsswitch.conf hosts; do
      mount --bind "$0/$file" "/etc/$file" || exit
    done
    exec "$@"' "$work" "${plain_on_robot[@]}")
  make_images "$work/name-images" 250 320 240
  start_stream name "$ADDRESS_cubic" "$work/name-images" 25
  : >"$work/hosts"
  sleep 3
  flows=(name)
  for ((repeat = 0; repeat < $1; ++repeat)); do outage 20; done
  read -r median worst < <(of_returns 20 name)
  results+=("RESULT link.name_return_median_s $median" "RESULT link.name_return_worst_s $worst")
  stop_from "$first"
  end_in_lookup
}

# end_in_lookup: SIGTERM to a robot without frames to deliver, whose name server never answers. Wants
# names's `on_robot`.
end_in_lookup() {
  local signalled
  cut_link
  start lookup "${on_robot[@]}" "$build/daemon/orbbufd" --set robot.id=r --set link.server=slam:7722 \
    --set 'link.drain_timeout=0 s' --set 'link.connect_timeout=1 s'
  wait_for lookup 'cannot resolve slam: no answer'
  signalled=$EPOCHREALTIME
  stop_from $((${#pids[@]} - 1))
  results+=("$(awk -v a="$signalled" -v b="$EPOCHREALTIME" 'BEGIN { printf "RESULT link.name_sigterm_s %.3f", b - a }')")
  mend_link
}

# sent_bytes COUNTER: what the robot has sent by now of what that counts.
sent_bytes() {
  "${on_robot[@]}" nft list counter inet cost "$1" | awk '/bytes/ { print $4 }'
}

attempt_cost() {
  local first=${#pids[@]} counter before=() after=()
  make_images "$work/cost-images" 250 320 240
  start_stream cost "$ADDRESS_cubic" "$work/cost-images" 25
  "${on_robot[@]}" nft 'add table inet cost
    add counter inet cost attempts; add counter inet cost sent
    add chain inet cost out { type filter hook output priority 0; }
    add rule inet cost out tcp flags & (syn | ack) == syn counter name attempts
    add rule inet cost out counter name sent'
  cut_link
  wait_for cost-robot 'stalled'
  for counter in attempts sent; do before+=("$(sent_bytes $counter)"); done
  sleep $COST_SECONDS
  for counter in attempts sent; do after+=("$(sent_bytes $counter)"); done
  mend_link
  stop_from "$first"
  "${on_robot[@]}" nft delete table inet cost
  results+=("RESULT link.stalled_attempts_bit_s $(((after[0] - before[0]) * 8 / COST_SECONDS))"
    "RESULT link.stalled_bit_s $(((after[1] - before[1]) * 8 / COST_SECONDS))")
}

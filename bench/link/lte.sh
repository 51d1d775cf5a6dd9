# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced after path.sh: recorded mobile links, of a camera that fills them most of the time. How
# often a stall is seen and another connection tried, and what that costs: beside a robot that takes
# nothing for a stall, over the same minutes of the same link.
LTE_ROUND_TRIP_MS=50
LTE_TRACES=${ORBBUF_TRACES:-$rig/../../../shared/data/traces}/mahimahi

# count_at_server NAME: bytes and packets that have come to the server by now.
count_at_server() {
  "${on_server[@]}" nft list counter inet lte "$1" | awk '/bytes/ { print $4, $2 }'
}

# on_mobile_link NAME TRACE SECONDS RESULT_NAME SETTING...
on_mobile_link() {
  local name=$1 first=${#pids[@]} from attempts attempts_before bytes bytes_before stalls
  lay_path $LTE_ROUND_TRIP_MS "$2"
  "${on_server[@]}" nft 'add table inet lte
    add counter inet lte attempts; add counter inet lte arrived
    add chain inet lte in { type filter hook input priority 0; }
    add rule inet lte in iifname far tcp flags & (syn | ack) == syn counter name attempts
    add rule inet lte in iifname far counter name arrived'
  start_stream "$name" "$ADDRESS_far" "$work/lte-images" 25 "${@:5}"
  from=$EPOCHREALTIME
  read -r bytes_before _ < <(count_at_server arrived)
  read -r _ attempts_before < <(count_at_server attempts)
  sleep "$3"
  read -r bytes _ < <(count_at_server arrived)
  read -r _ attempts < <(count_at_server attempts)
  stalls=$(grep -c 'stalled, nothing' "$work/$name-robot.err" || true)
  stop_from "$first"
  "${on_server[@]}" nft delete table inet lte
  mapfile -t -O ${#results[@]} results < <(awk -v from="$from" -v s="$3" -v n="$4" -v stalls="$stalls" \
    -v attempts=$((attempts - attempts_before)) -v all=$((bytes - bytes_before)) '
    $1 > from && $1 < from + s { bytes += $2; if (last && $1 - last > most) most = $1 - last; last = $1 }
    END {
      printf "RESULT %s.attempts_per_min %.1f\n", n, 60 * attempts / s
      printf "RESULT %s.stalls_per_min %.1f\n", n, 60 * stalls / s
      printf "RESULT %s.delivered_kbit_s %.0f\n", n, 8e-3 * bytes / s
      printf "RESULT %s.wasted_kbit_s %.0f\n", n, 8e-3 * (all - bytes) / s
      printf "RESULT %s.longest_wait_s %.2f\n", n, most
    }' "$work/$name.out")
  rm -rf "${work:?}/$name"
}

mobile_links() { # SECONDS
  local trace name
  make_images "$work/lte-images" 250 640 480
  for trace in "$LTE_TRACES"/*.up; do
    [ -e "$trace" ] || { say "bench: skipped: mobile links, whose traces are not in $LTE_TRACES" && return; }
    name=$(basename "$trace" | cut -d - -f 1 | tr '[:upper:]' '[:lower:]')
    on_mobile_link "lte-$name" "$trace" "$1" "link.lte.$name"
    on_mobile_link "lte-$name-patient" "$trace" "$1" "link.lte.$name.patient" 'link.stall_timeout=1 h'
  done
}

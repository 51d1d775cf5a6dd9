# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced after path.sh: 64 kbit/s and a queue of 2 s, which a plain TCP connection of the same
# host keeps full: how many frames arrive nevertheless.
SLOW_SECONDS=60

slow_link() {
  local first=${#pids[@]} from stalls connections
  make_images "$work/slow-images" 250 320 240
  tc -n "$robot_ns" qdisc replace dev wire root tbf rate 64kbit burst 1600 latency 2s
  start other "${on_server[@]}" "$build/bench/orbbuf-link-peer" receive "$ADDRESS_cubic" 5003
  wait_for other listening
  start other-send "${on_robot[@]}" "$build/bench/orbbuf-link-peer" send "$ADDRESS_cubic" 5003 2000 100
  sleep 10
  from=$EPOCHREALTIME
  start_stream slow "$ADDRESS_cubic" "$work/slow-images" 25
  sleep $SLOW_SECONDS
  stalls=$(grep -c 'stalled, nothing' "$work/slow-robot.err" || true)
  connections=$(grep -c 'connected to' "$work/slow-robot.err" || true)
  stop_from "$first"
  results+=("RESULT link.slow.connect_s $(connect_seconds slow)" "RESULT link.slow.stalls $stalls"
    "RESULT link.slow.connections $connections")
  mapfile -t -O ${#results[@]} results < <(awk -v from="$from" -v s=$SLOW_SECONDS '
    FNR == NR { if ($1 > from) other += $2; next }
    { ++frames; bytes += $2; if ($1 - from < 25) ++early; gap = $1 - (last ? last : from); last = $1; if (gap > most) most = gap }
    END {
      printf "RESULT link.slow.frames_in_25_s %d\n", early
      printf "RESULT link.slow.frames_per_min %.0f\n", 60 * frames / s
      printf "RESULT link.slow.longest_wait_s %.1f\n", most
      printf "RESULT link.slow.kbit_s %.1f\nRESULT link.slow.others_kbit_s %.1f\n", 8e-3 * bytes / s, 8e-3 * other / s
    }' "$work/other.out" "$work/slow.out")
}

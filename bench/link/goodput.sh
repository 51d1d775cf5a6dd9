# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced after rig.sh: what share of iperf3's goodput on the same link is JPEG bytes in the
# server's files, when the camera has more frames than the link can take.
SECONDS_EACH=10

# What iperf3's receiver counts second by second, in bit/s, but for the first and the last: its sum
# has what stood in the link's queue when the sender's time was over.
iperf_rate() { # ADDRESS
  local first=${#pids[@]}
  start iperf "${on_server[@]}" iperf3 -s -1 -i 1 -f k --forceflush -B "$1" -p 5201
  wait_for iperf 'listening'
  "${on_robot[@]}" iperf3 -c "$1" -p 5201 -t $((SECONDS_EACH + 2)) -f k >"$work/iperf-client.out"
  stop_from "$first"
  awk -v l=$SECONDS_EACH '
    /Kbits.sec/ && !/receiver/ {
      for (i = 2; i <= NF; ++i) if ($i == "Kbits/sec") rate[++n] = $(i - 1)
    }
    END {
      for (i = 2; i <= l + 1; ++i) sum += rate[i]
      printf "%.0f\n", 1000 * sum / l
    }' "$work/iperf.out"
}

# From frame to frame, so that frames that are partly over do not count.
orbbuf_rate() { # NAME ADDRESS [with|without samples beside]
  local first=${#pids[@]} begin
  beside_stream "$1" "${3:-without}" "$2" "$work/large" 30
  sleep 3 # slow start is over, and what it lost is repaired
  begin=$EPOCHREALTIME
  sleep $SECONDS_EACH
  stop_from "$first"
  awk -v a="$begin" -v l=$SECONDS_EACH '
    $1 < a || $1 > a + l { next }
    !t { t = $1; next }
    { bytes += $2; last = $1 }
    END { printf "%.0f\n", 8 * bytes / (last - t) }' "$work/$1.out"
  rm -rf "${work:?}/$1"
}

goodput() { # MBIT...
  local mbit control address ours iperf share name
  make_images "$work/large" 60 1600 1200
  for mbit in "$@"; do
    shape "$mbit"
    for control in "${controls[@]}"; do
      address=ADDRESS_$control
      iperf=$(iperf_rate "${!address}")
      ours=$(orbbuf_rate "goodput-$control-$mbit" "${!address}")
      share=$(awk -v a="$ours" -v b="$iperf" 'BEGIN { printf "%.3f", a / b }')
      printf '  link %2d Mbit/s  %-5s  iperf3 %8.0f bit/s  orbbufd %8.0f bit/s\n' \
        "$mbit" "$control" "$iperf" "$ours"
      name=link.goodput_share
      [ "$control" = cubic ] || name=link.$control.goodput_share
      results+=("RESULT $name.$mbit $share")
    done
  done
}

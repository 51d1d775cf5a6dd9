# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced after rig.sh: how much stands in the kernel of the robot, where the policy cannot
# reach it any more, and for how long a frame that is chosen is under way, when the camera has more
# frames than the link can take. With the daemon's limit of what may be unsent (TCP_NOTSENT_LOWAT),
# without it, and with a small send buffer instead (as SO_SNDBUF makes it).
QUEUE_SECONDS=12 # for each; at first for slow start and for queues to fill
QUEUE_SETTLING=4
SMALL_SEND_BUFFER=65536

# What stands in the sending socket, every 50 ms: TIME BYTES_UNACKED_OR_UNSENT BYTES_UNSENT.
sample_queue() { # ADDRESS
  # shellcheck disable=SC2016
  exec "${on_robot[@]}" bash -c '
    while :; do
      printf "%s %s\n" "$EPOCHREALTIME" "$(ss -tinHO state established dst "$1")"
      sleep 0.05
    done' - "$1"
}

# p50 and p95 of a column of numbers; "- -" if there are none.
percentiles() {
  sort -n | awk '{ v[NR] = $1 }
    END {
      if (NR) printf "%.1f %.1f\n", v[int((NR + 1) / 2)], v[int(0.95 * NR + 0.999)]
      else print "- -"
    }'
}

# From the moment a frame is chosen, in the robot's log, to its file's appearance; milliseconds.
under_way() { # NAME FROM
  awk -v from="$2" '
    FNR == NR { at[$2] = $1; next }
    $1 > from && ($3 + 0) in at { print 1000 * ($1 - at[$3 + 0]) }
  ' <(chosen "$1") "$work/$1.out"
}

# queue_of NAME ADDRESS IMAGES FPS UNSENT: sets `unsent`, `held` (KiB) and `age` (ms), each p50 p95,
# and `rate`, the Mbit/s of JPEG bytes that arrive.
queue_of() {
  local name=$1 first=${#pids[@]} from
  start_stream "$name" "$2" "$3" "$4" log.level=debug buffer.policy=drop-oldest "link.unsent=$5"
  start "$name-queue" sample_queue "$2"
  sleep $QUEUE_SETTLING
  from=$EPOCHREALTIME
  sleep $((QUEUE_SECONDS - QUEUE_SETTLING))
  stop_from "$first"
  age=$(under_way "$name" "$from" | percentiles)
  held=$(awk -v f="$from" '$1 > f && NF > 5 { print $3 / 1024 }' "$work/$name-queue.out" |
    percentiles)
  unsent=$(awk -v f="$from" '$1 > f && NF > 5 {
    n = 0
    if (match($0, /notsent:[0-9]+/)) n = substr($0, RSTART + 8, RLENGTH - 8)
    print n / 1024
  }' "$work/$name-queue.out" | percentiles)
  rate=$(awk -v f="$from" '$1 > f { if (t) bytes += $2; else t = $1; last = $1 }
    END { printf "%.2f", (last > t ? 8e-6 * bytes / (last - t) : 0) }' "$work/$name.out")
  rm -rf "${work:?}/$name"
}

queues() { # MBIT...
  local mbit control address images fps kind limit name unsent held age rate wmem
  make_images "$work/queue-small" 250 320 240
  make_images "$work/queue-large" 250 800 600
  wmem=$("${on_robot[@]}" sysctl -n net.ipv4.tcp_wmem)
  printf '  %-34s %17s %17s %17s %7s\n' 'median, 95th percentile' 'unsent KiB' \
    'with unacked KiB' 'chosen-arrived ms' Mbit/s
  for mbit in "$@"; do
    shape "$mbit"
    read -r images fps < <(awk -v r="$mbit" -v w="$work" 'BEGIN {
      print w (r > 10 ? "/queue-large 600" : r > 5 ? "/queue-small 250" : "/queue-small 50") }')
    for control in "${controls[@]}"; do
      address=ADDRESS_$control
      for kind in lowat none sndbuf; do
        limit=1GiB && [ $kind != lowat ] || limit=16KiB
        [ $kind != sndbuf ] || "${on_robot[@]}" sysctl -q -w \
          "net.ipv4.tcp_wmem=4096 16384 $SMALL_SEND_BUFFER"
        queue_of "queue-$control-$mbit-$kind" "${!address}" "$images" "$fps" $limit
        "${on_robot[@]}" sysctl -q -w "net.ipv4.tcp_wmem=$wmem"
        printf '  %5s Mbit/s  %-5s  %-14s %17s %17s %17s %7s\n' "$mbit" "$control" "$kind" \
          "$unsent" "$held" "$age" "$rate"
        name=$control.$mbit
        [ $kind = lowat ] || name=$kind.$name
        results+=("RESULT link.queue_kib.$name ${held% *}"
          "RESULT link.queue_age_ms.$name ${age% *}")
      done
    done
  done
}

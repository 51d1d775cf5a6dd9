# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced after rig.sh: when the stream is live again after an outage, what of the outage arrives, and what a
# link that is too slow for good delivers. 25 frames a second of 40 kB, which is 8 Mbit/s; 10 ms of round trip; default
# settings. A frame's lateness is from its capture to its file, beyond that of the frame with the shortest way; the stream
# is live again with the first frame that is at most 0.2 s late (evaluation/real/summary.sh).
LIVE_FPS=25
LIVE_RATES=(20 12) # Mbit/s, 2.5 and 1.5 times the need
LIVE_IMAGES=250
LIVE_SLOW_SECONDS=60

# lay_modem: robot - delay - modem - server. The queue is the modem's, as on a robot: what TCP has sent into it TCP
# cannot see there. `live_address` is the server's behind it.
lay_modem() {
  live_address=10.79.0.2
  lay_path 10
  ip netns add "$modem_ns"
  ip -n "$server_ns" link set far netns "$modem_ns"
  ip -n "$modem_ns" addr add "$ADDRESS_far/24" dev far
  ip -n "$modem_ns" link set far up
  ip -n "$modem_ns" link add air type veth peer name air netns "$server_ns"
  ip -n "$modem_ns" addr add 10.79.0.1/24 dev air
  ip -n "$modem_ns" link set air up
  ip -n "$server_ns" addr add "$live_address/24" dev air
  ip -n "$server_ns" link set air up
  ip -n "$server_ns" route add 10.78.0.0/24 via 10.79.0.1
  ip netns exec "$modem_ns" sysctl -q -w net.ipv4.ip_forward=1
}

lift_modem() { # FIRST
  stop_from "$1"
  ip netns del "$modem_ns"
}

# shape_modem MBIT QUEUE_MS BURST_KB
shape_modem() {
  tc -n "$modem_ns" qdisc replace dev air root tbf rate "$1mbit" burst "${3}kb" latency "${2}ms"
}

# live_stream NAME CONTROL: a stream through the modem, past slow start.
live_stream() {
  ip -n "$robot_ns" route replace 10.79.0.0/24 via "$ADDRESS_far" dev near congctl "$2"
  start_stream "$1" "$live_address" "$work/live-images" $LIVE_FPS
  sleep 4
}

# live_outages NAME SECONDS REPEATS: lines CUT MENDED go to $work/NAME.outages.
live_outages() {
  local name=$1 seconds=$2 repeat cut
  : >"$work/$name.outages"
  for ((repeat = 0; repeat < $3; ++repeat)); do
    cut=$EPOCHREALTIME
    cut_link
    sleep "$seconds"
    mend_link
    echo "$cut $EPOCHREALTIME" >>"$work/$name.outages"
    sleep "$(awk -v r="$RANDOM" -v s="$seconds" 'BEGIN { printf "%.3f", 4 + s / 8 + r / 32768 }')"
  done
}

# live_arrivals NAME: lines FRAME TIME for summary.sh.
live_arrivals() { awk '{ print $3 + 0, $1 }' "$work/$1.out" | sort -n; }

# again_of NAME: median and worst of the seconds from a return until the stream is live. In a subshell, since summary.sh
# has a `returns`, as return.sh has.
again_of() (
  # shellcheck source=evaluation/real/summary.sh
  . "$rig/../../evaluation/real/summary.sh"
  live_again "$work/$1.outages" <(live_arrivals "$1") $LIVE_FPS
)

# live_matrix REPEATS: over rates and queues of the link, the bursts that it passes, and the congestion control.
live_matrix() {
  local mbit queue burst control name first median worst
  for mbit in "${LIVE_RATES[@]}"; do
    for queue in 30 100 300 1000; do
      for burst in 5 32; do
        for control in "${controls[@]}"; do
          name=live-$mbit-$queue-$burst-$control first=${#pids[@]}
          lay_modem
          shape_modem "$mbit" "$queue" "$burst"
          live_stream "$name" "$control"
          live_outages "$name" 2 "$1"
          lift_modem "$first"
          read -r median worst < <(again_of "$name")
          printf '  %s Mbit/s, queue %4s ms, burst %2s kB, %-5s  live again %s s, worst %s s\n' \
            "$mbit" "$queue" "$burst" "$control" "$median" "$worst"
          name=$queue.$burst.$control
          [ "$mbit" = "${LIVE_RATES[0]}" ] || name+=.$mbit
          results+=("RESULT link.live_again_median_s.$name $median")
          echo "$queue $burst $worst" >>"$work/live-worst"
        done
      done
    done
  done
  mapfile -t -O ${#results[@]} results < <(awk '$2 == 32 && (!($1 in w) || w[$1] != "never" && ($3 == "never" || $3 > w[$1])) { w[$1] = $3 }
    END { for (q in w) printf "RESULT link.live_again_worst_s.%s %s\n", q, w[q] }' "$work/live-worst" | sort -V)
}

# live_shares NAME: a line SHARE GAP for each outage: of the frames that are captured in it, how many arrive live; and the
# most in a row that are missing, up to the next outage. Capture times are those of the frame with the shortest way.
live_shares() {
  awk -v f=$LIVE_FPS '
    FNR == NR { cut[++n] = $1; mended[n] = $2; next }
    { began = $2 - $1 / f; if (FNR == 1 || began < begin) begin = began; frame[++m] = $1 }
    END {
      cut[n + 1] = 1e99
      for (i = 1; i <= n; ++i) {
        all = arrived = gap = 0
        for (k = int((cut[i] - begin) * f) + 1; k <= (mended[i] - begin) * f; ++k) { ++all; down[k] = i }
        for (j = 1; j <= m; ++j) {
          if (down[frame[j]] == i) ++arrived
          at = begin + frame[j] / f
          if (j > 1 && at > cut[i] && at < cut[i + 1] && frame[j] - frame[j - 1] - 1 > gap) gap = frame[j] - frame[j - 1] - 1
        }
        printf "%.3f %d\n", arrived / all, gap
      }
    }' "$work/$1.outages" <(live_arrivals "$1")
}

# live_lengths OUTAGE:REPEATS...: outages of several lengths.
live_lengths() {
  local plan name first seconds median worst share gap
  for plan in "$@"; do
    seconds=${plan%:*} name=live-for-$seconds first=${#pids[@]}
    lay_modem
    shape_modem "${LIVE_RATES[0]}" 100 32
    live_stream "$name" cubic
    live_outages "$name" "$seconds" "${plan#*:}"
    lift_modem "$first"
    read -r median worst < <(again_of "$name")
    share=$(live_shares "$name" | sort -n | awk '{ v[NR] = $1 } END { print v[int((NR + 1) / 2)] }')
    gap=$(live_shares "$name" | awk '$2 > gap { gap = $2 } END { print gap + 0 }')
    results+=("RESULT link.live.$seconds.live_share $share" "RESULT link.live.$seconds.longest_gap $gap"
      "RESULT link.live.$seconds.live_again_s $median")
  done
}

# slow_of NAME FROM TO RESULT: of the frames that are captured in that time.
slow_of() {
  live_arrivals "$1" | awk -v f=$LIVE_FPS '{ late = $2 - $1 / f; if (NR == 1 || late < least) least = late; frame[NR] = $1; at[NR] = late }
    END { for (i = 2; i <= NR; ++i) printf "%.3f %.4f %d\n", least + frame[i] / f, at[i] - least, frame[i] - frame[i - 1] }' |
    awk -v from="$2" -v to="$3" '$1 >= from && $1 <= to' | sort -k2n |
    awk -v n="$(awk -v a="$2" -v b="$3" -v f=$LIVE_FPS 'BEGIN { print (b - a) * f }')" -v name="RESULT link.slow.$4" '
      { late[NR] = $2; if ($3 > step) step = $3 }
      END { printf "%s.delivered_share %.3f\n%s.late_p95_s %.3f\n%s.longest_step %d\n",
          name, NR / n, name, late[int(0.95 * (NR - 1)) + 1], name, step }'
}

# slow_lives: the link falls to a half and to a quarter of the need.
slow_lives() {
  local part name first from to need
  need=$(cat "$work"/live-images/*.jpg | wc -c | awk -v n=$LIVE_IMAGES -v f=$LIVE_FPS '{ print 8e-6 * $1 / n * f }')
  for part in half:2 quarter:4; do
    name=live-${part%:*} first=${#pids[@]}
    lay_modem
    shape_modem "${LIVE_RATES[0]}" 100 32
    live_stream "$name" cubic
    from=$EPOCHREALTIME
    shape_modem "$(awk -v need="$need" -v by="${part#*:}" 'BEGIN { printf "%.3f", need / by }')" 100 32
    sleep $LIVE_SLOW_SECONDS
    to=$EPOCHREALTIME
    sleep 3
    lift_modem "$first"
    mapfile -t -O ${#results[@]} results < <(slow_of "$name" "$from" "$to" "${part%:*}")
  done
}

lives() { # REPEATS OUTAGE:REPEATS...
  make_images "$work/live-images" $LIVE_IMAGES 568 426 # 40 kB each
  live_matrix "$1"
  live_lengths "${@:2}"
  slow_lives
}

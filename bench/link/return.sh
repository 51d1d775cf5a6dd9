# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced after rig.sh: how long after the link's return the first frame is at the server, for
# orbbufd under each congestion control and for the baselines, all through the same outages.
FPS=25
IMAGE_BYTES=12288 # of a baseline's frame; orbbufd's have that on average

flows=()

start_rivals() {
  start plain "${on_server[@]}" "$build/bench/orbbuf-link-peer" receive "$ADDRESS_cubic" 5001
  wait_for plain listening
  start plain-send "${on_robot[@]}" "$build/bench/orbbuf-link-peer" send "$ADDRESS_cubic" 5001 \
    $IMAGE_BYTES $FPS
  flows+=(plain)
  start_ros "$build/bench/orbbuf-ros-peer" || return 0
  start roscpp-send "${ros_on_robot[@]}" "$build/bench/orbbuf-ros-peer" send $IMAGE_BYTES $FPS
  flows+=(roscpp)
}

# first_after FLOW TIME: when the first frame came after TIME; nothing if none has yet.
first_after() { awk -v t="$2" '$1 > t { print $1; exit }' <(tail -n 4000 "$work/$1.out"); }

# One outage; a line OUTAGE FLOW SECONDS for each flow goes to $work/returns.
outage() { # SECONDS
  local returned flow first limit=$((${1%.*} * 2 + 30))
  cut_link
  sleep "$1"
  returned=$EPOCHREALTIME # before the command that mends it: never to our advantage
  mend_link
  for flow in "${flows[@]}"; do
    SECONDS=0
    until first=$(first_after "$flow" "$returned") && [ -n "$first" ]; do
      [ $SECONDS -lt $limit ] || { say "bench link: $flow never came back" && exit 1; }
      sleep 0.05
    done
    awk -v o="$1" -v f="$flow" -v a="$returned" -v b="$first" \
      'BEGIN { printf "%s %s %.3f\n", o, f, b - a }' | tee -a "$work/returns" |
      awk '{ printf "  outage %4s s  %-13s first frame %6.3f s after the return\n", $1, $2, $3 }'
  done
  # Back to normal, and on to any moment of any timer.
  sleep "$(awk -v r="$RANDOM" 'BEGIN { printf "%.3f", 2 + r / 32768 }')"
}

# of_returns OUTAGE FLOW: median and worst.
of_returns() {
  awk -v o="$1" -v f="$2" '$1 == o && $2 == f { print $3 }' "$work/returns" | sort -n |
    awk '{ v[NR] = $1 }
      END { printf "%.3f %.3f\n", (v[int((NR + 1) / 2)] + v[int(NR / 2) + 1]) / 2, v[NR] }'
}

# through PLAN...: the outages, for what is in `flows`.
through() {
  local flow plan repeat
  sleep 3
  for flow in "${flows[@]}"; do
    [ -s "$work/$flow.out" ] || { say "bench link: nothing arrives of $flow" && exit 1; }
  done
  for plan in "$@"; do
    for ((repeat = 0; repeat < ${plan#*:}; ++repeat)); do outage "${plan%:*}"; done
  done
  stop_from 0
}

# conclude FLOW NAME PLAN...: the RESULT lines NAME.return_median_s and NAME.return_worst_s.
conclude() {
  local flow=$1 name=$2 plan median worst
  for plan in "${@:3}"; do
    read -r median worst < <(of_returns "${plan%:*}" "$flow")
    results+=("RESULT $name.return_median_s.${plan%:*} $median"
      "RESULT $name.return_worst_s.${plan%:*} $worst")
  done
}

# returns_alone FLOW NAME PLAN...: orbbufd has the link to itself, so that the round trip is the
# link's own. With `stream_settings`.
returns_alone() {
  make_images "$work/$1-images" 250 320 240
  shape 20
  start_stream "$1" "$ADDRESS_cubic" "$work/$1-images" $FPS "${stream_settings[@]}"
  flows=("$1")
  through "${@:3}"
  conclude "$1" "$2" "${@:3}"
}

returns() { # OUTAGE:REPEATS...
  local stream_settings=()
  returns_alone orbbufd link "$@"
}

returns_tls() { # OUTAGE:REPEATS...
  local server_settings stream_settings
  make_keys "IP:$ADDRESS_cubic"
  returns_alone tls link.tls "$@"
}

# The baselines, and orbbufd under bbr, share the link: what one of them sends after its return waits
# in the queue before the others' first frame.
returns_of_rivals() { # OUTAGE:REPEATS...
  local flow name
  make_images "$work/small" 250 320 240
  shape 20
  flows=()
  if [[ " ${controls[*]} " == *" bbr "* ]]; then
    start_stream bbr "$ADDRESS_bbr" "$work/small" $FPS
    flows=(bbr)
  fi
  start_rivals
  through "$@"
  for flow in "${flows[@]}"; do
    name=link.$flow
    [ "$flow" = plain ] && name=link.plain_tcp
    conclude "$flow" "$name" "$@"
  done
}

# sizes_of FILE: a line TIME BYTES when it has grown.
sizes_of() {
  local size last=0
  while sleep 0.01; do
    size=$(stat -c %s "$1" 2>/dev/null) || continue
    [ "$size" = "$last" ] || printf '%s %s\n' "$EPOCHREALTIME" "$size"
    last=$size
  done
}

# ngtcp2's example programs: the robot is the one that sends, a large file as fast as the link takes it.
returns_of_quic() { # OUTAGE:REPEATS...
  local server_settings stream_settings
  if ! command -v gtlsserver >/dev/null || ! command -v gtlsclient >/dev/null; then
    say 'bench: skipped: QUIC (Debian: ngtcp2-client ngtcp2-server)'
    return
  fi
  make_keys IP:10.77.0.1
  shape 20
  mkdir "$work/quic" "$work/quic-received"
  truncate -s 20G "$work/quic/frames"
  start quic-send "${on_robot[@]}" gtlsserver -q --timeout=10m -d "$work/quic" 10.77.0.1 4433 \
    "${server_settings[1]#*=}" "${server_settings[0]#*=}"
  sleep 1
  start quic-receive "${on_server[@]}" gtlsclient -q --timeout=10m --download="$work/quic-received" \
    10.77.0.1 4433 https://10.77.0.1:4433/frames
  start quic sizes_of "$work/quic-received/frames"
  flows=(quic)
  through "$@"
  conclude quic link.quic "$@"
}

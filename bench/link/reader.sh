# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced after rig.sh: a SLAM program that takes frames at half the camera's rate. How many
# frames are beyond the policy, chosen by the robot and not yet read by the program, and for how
# long; and how even the stream is that the program reads.
READER_FPS=12.5 # of the camera's 25
READER_SECONDS=20
READER_SETTLING=5

# beyond NAME FROM TO: of each hundredth of a second, how many frames are beyond the policy.
beyond() {
  awk -v from="$2" -v to="$3" '
    FNR == NR { chosen[$2] = $1; next }
    $3 in chosen {
      for (t = int(100 * (chosen[$3] - from)) + 1; t <= 100 * ($1 - from); ++t) ++count[t]
    }
    END { for (t = 1; t <= 100 * (to - from); ++t) print count[t] + 0 }
  ' <(chosen "$1") "$work/$1-program.out"
}

# beyond_ms NAME FROM TO: of each frame that was read, the time since it was chosen.
beyond_ms() {
  awk -v from="$2" -v to="$3" '
    FNR == NR { chosen[$2] = $1; next }
    $1 > from && $1 < to && ($3 in chosen) { print 1000 * ($1 - chosen[$3]) }
  ' <(chosen "$1") "$work/$1-program.out"
}

# gaps NAME FROM TO: from each frame that was read to the next, in frames of the camera; the smallest
# and the largest.
gaps() {
  awk -v from="$2" -v to="$3" '
    $1 < from || $1 > to { next }
    n++ {
      gap = $3 - last
      if (n == 2 || gap < min) min = gap
      if (gap > max) max = gap
    }
    { last = $3 }
    END { print min, max }' "$work/$1-program.out"
}

slow_reader() { # FORMAT RESULT_NAME
  local name=reader-$1 first=${#pids[@]} from to frames ms min max
  local server_settings=("slam.format=$1"
    "slam.command=exec '$build/bench/orbbuf-link-peer' read $READER_FPS >'$work/$name-program.out'")
  start_stream "$name" "$ADDRESS_cubic" "$work/reader" 25 log.level=debug
  sleep $READER_SETTLING
  from=$EPOCHREALTIME
  sleep $((READER_SECONDS - READER_SETTLING))
  to=$(awk -v now="$EPOCHREALTIME" 'BEGIN { printf "%.6f", now - 2 }') # those chosen are read by now
  stop_from "$first"
  frames=$(beyond "$name" "$from" "$to" | percentiles)
  ms=$(beyond_ms "$name" "$from" "$to" | percentiles)
  read -r min max < <(gaps "$name" "$from" "$to")
  printf '  %-6s beyond the policy: %s frames, %s ms (median, 95th percentile); gaps %s to %s\n' \
    "$1" "${frames/ /, }" "${ms/ /, }" "$min" "$max"
  results+=("RESULT $2.beyond_frames ${frames#* }" "RESULT $2.beyond_ms ${ms#* }"
    "RESULT $2.gap_min $min" "RESULT $2.gap_max $max")
}

slow_readers() {
  make_images "$work/reader" 250 640 480
  shape 20
  slow_reader pgm link.reader
  slow_reader mjpeg link.reader.mjpeg
}

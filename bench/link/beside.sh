# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced after return.sh and goodput.sh: what 1,000 samples a second of an inertial sensor cost the frames beside
# them. By turns with and without them, in one run: how late frames are in calm, how soon they come after an outage, and
# how much of the link's rate is frames. A RESULT is the ratio of both.
BESIDE_TURNS=6

# beside_stream NAME WITH ADDRESS IMAGES FPS [SETTING...]
beside_stream() {
  local settings=("${@:6}")
  [ "$2" = without ] || settings+=(stream.imu0.kind=socket "stream.imu0.path=$work/$1.imu")
  start_stream "$1" "$3" "$4" "$5" "${settings[@]}"
  [ "$2" = without ] || start "$1-sensor" python3 "$rig/../../examples/imu_driver.py" "$work/$1.imu" 1000 # 1 kHz
}

# beside_calm TURN WITH: from capture to file, in ms, a line for each frame in $work/WITH.late.
beside_calm() {
  local name=calm-$2-$1 first=${#pids[@]}
  beside_stream "$name" "$2" "$ADDRESS_cubic" "$work/beside-images" $FPS \
    source.kind=generated source.width=320 source.height=240 source.frames=1000000
  sleep 2
  : >"$work/$name.out"
  sleep 15
  awk 'NR == FNR { captured[sprintf("%06d.jpg", $1)] = $2; next }
    $3 in captured { printf "%.3f\n", ($1 - captured[$3]) * 1000 }' \
    "$work/$name"/*/*/times.txt "$work/$name.out" >>"$work/$2.late"
  stop_from "$first"
}

# beside_return TURN WITH: the flow WITH in $work/returns.
beside_return() {
  local repeat first=${#pids[@]}
  flows=("$2")
  beside_stream "$2" "$2" "$ADDRESS_cubic" "$work/beside-images" $FPS
  sleep 2
  for ((repeat = 0; repeat < 6; ++repeat)); do outage 2; done
  stop_from "$first"
  rm -rf "${work:?}/$2"
}

# rank SHARE FILE: the value that this share of the lines is not above.
rank() { sort -n "$2" | awk -v s="$1" '{ v[NR] = $1 } END { i = int(NR * s + 0.999); print v[i < 1 ? 1 : i] }'; }

beside() {
  local turn with mbit=50 quantity
  make_images "$work/beside-images" 250 320 240
  make_images "$work/large" 60 1600 1200
  for ((turn = 0; turn < BESIDE_TURNS; ++turn)); do
    for with in without with; do
      shape 20
      beside_calm $turn $with
      beside_return $turn $with
      shape $mbit
      orbbuf_rate "rate-$with" "$ADDRESS_cubic" $with >>"$work/$with.rates"
    done
  done
  for with in without with; do
    echo "$(rank 0.5 "$work/$with.late") $(rank 0.99 "$work/$with.late")" \
      "$(awk -v f=$with '$2 == f { print $3 }' "$work/returns" | sort -n >"$work/$with.returns" && rank 0.5 "$work/$with.returns")" \
      "$(awk '{ sum += $1 } END { printf "%.0f", sum / NR }' "$work/$with.rates")" >"$work/$with.figures"
    echo "  $with samples: latency p50, p99 in ms, return median in s, frames in bit/s: $(cat "$work/$with.figures")"
  done
  while read -r quantity; do
    results+=("RESULT link.beside_samples.$quantity")
  done < <(paste -d' ' "$work/without.figures" "$work/with.figures" | awk '{
    split("latency_p50 latency_p99 return_median goodput", name, " ")
    for (i = 1; i <= 4; ++i) printf "%s_ratio %.3f\n", name[i], $(i + 4) / $i }')
}

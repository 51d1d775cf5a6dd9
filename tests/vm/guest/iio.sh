# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# A driver of the kernel's Industrial I/O, bmi160, over registers that a program has written, with a timer as its
# trigger: 200 samples a second. The kernel's own trace of the timer says when each was.

modprobe -a configfs i2c-dev iio-trig-hrtimer bmi160_i2c
modprobe i2c-stub chip_addr=0x68
busybox mount -t configfs configfs /sys/kernel/config 2>/dev/null
busybox mount -t tracefs tracefs /sys/kernel/tracing 2>/dev/null
bus=$(basename "$(dirname "$(grep -l 'SMBus stub' /sys/bus/i2c/devices/i2c-*/name)")")
# registers FIRST VALUE...: of the chip; its identity, then gyroscope and accelerometer: x, y, z.
registers() {
  local register=$(($1)) value
  for value in "${@:2}"; do
    i2cset -y "${bus#i2c-}" 0x68 "$(printf 0x%x $register)" "$value"
    register=$((register + 1))
  done
}
registers 0x00 0xd1
registers 0x41 0x03
registers 0x0c 0x00 0x10 0x00 0xf0 0x00 0x01
registers 0x12 0x00 0x20 0x00 0xe0 0x00 0x40
echo bmi160 0x68 >"/sys/bus/i2c/devices/$bus/new_device"
chip=$(dirname "$(grep -l bmi160 /sys/bus/iio/devices/iio:device*/name)")
mkdir /sys/kernel/config/iio/triggers/hrtimer/timer
echo 200 >"$(dirname "$(grep -l '^timer$' /sys/bus/iio/devices/trigger*/name)")/sampling_frequency"
echo timer >"$chip/trigger/current_trigger"

orbbufd --list-imus >"$log" 2>&1
expect 'its name' grep -q bmi160 "$log"
verdict 'iio: --list-imus'

trace=/sys/kernel/tracing
echo mono >$trace/trace_clock
echo 20000 >$trace/buffer_size_kb
symbol=$(awk '/ iio_hrtimer_trig_handler/ {print $1}' /proc/kallsyms)
echo "function==0x$symbol" >$trace/events/timer/hrtimer_expire_entry/filter
echo 1 >$trace/events/timer/hrtimer_expire_entry/enable
orbbufd --set robot.id=iio --set source.width=160 --set source.height=120 --set source.fps=10 --set source.frames=250 \
  --set stream.imu0.kind=iio --set 'stream.imu0.device="bmi160"' >"$log" 2>&1 &
daemon=$!
# The two clocks at one moment: of 50 marks in the trace the one that took least.
for ((i = 0; i < 50; ++i)); do
  before=$EPOCHREALTIME
  echo "mark $before" >$trace/trace_marker
  echo "$before $EPOCHREALTIME"
done >marks.txt
expect 'ends' ends_with 0
echo 0 >$trace/events/timer/hrtimer_expire_entry/enable
cat $trace/trace >trace.txt
samples=$(session_of iio)/imu0/data.csv
expect '20 s of samples' [ "$(grep -vc '^#' "$samples")" -ge 4000 ]
gyro=$(cat "$chip/in_anglvel_scale") accel=$(cat "$chip/in_accel_scale")
# shellcheck disable=SC2016 # awk's own $
expect 'scaled' awk -F, -v g="$gyro" -v a="$accel" '
  function is(x, y) { return x - y < 1e-6 * (y < 0 ? -y : y) && y - x < 1e-6 * (y < 0 ? -y : y) }
  /^#/ { next }
  !is($2, 4096 * g) || !is($3, -4096 * g) || !is($4, 256 * g) || !is($5, 8192 * a) || !is($6, -8192 * a) || !is($7, 16384 * a) { bad = 1 }
  { ++n }
  END { exit bad || !n }' "$samples"
# How long after its timer each sample was, in microseconds.
awk -F'[ :,]+' '
  FILENAME == "marks.txt" { took[$1] = $2 - $1; next }
  FILENAME == "trace.txt" {
    for (i = 1; i <= NF; ++i) if ($i ~ /^[0-9]+\.[0-9]+$/) { mono = $i; break }
    if (/hrtimer_expire_entry/) fired[++n] = mono
    if (match($0, /mark [0-9.]+/)) {
      mark = substr($0, RSTART + 5, RLENGTH - 5)
      if (!best || took[mark] < best) { best = took[mark]; offset = mark + best / 2 - mono }
    }
    next
  }
  /^#/ { next }
  {
    at = substr($1, 1, 10) - offset + (1 substr($1, 11)) / 1e9 - 1 # 1: zeros before would mean octal
    while (k < n && fired[k + 1] <= at + best) ++k
    printf "%.0f\n", (at - fired[k]) * 1e6
  }' marks.txt trace.txt "$samples" | sort -n >late.txt
count=$(wc -l <late.txt)
echo "RESULT vm.iio.samples $count"
echo "RESULT vm.iio.late_median_us $(sed -n "$((count / 2 + 1))p" late.txt)"
echo "RESULT vm.iio.late_p99_us $(sed -n "$((count * 99 / 100))p" late.txt)"
echo "RESULT vm.iio.late_worst_us $(tail -n 1 late.txt)"
# Not all: between the timer and the stamp, both of them the kernel's, an emulated processor may stand still.
expect '99 of 100 within 1 ms of the timer' [ "$(sed -n "$((count * 99 / 100))p" late.txt)" -le 1000 ]
expect 'none before it' [ "$(head -n 1 late.txt)" -ge -1000 ]
verdict 'iio: bmi160 at 200 Hz, within 1 ms of its timer'

orbbufd --set robot.id=unplugged --set source.width=160 --set source.height=120 --set source.fps=10 --set source.loop=true \
  --set stream.imu0.kind=iio --set 'stream.imu0.device="bmi160"' >"$log" 2>&1 &
daemon=$!
expect 'frames' wait_for 30 has_frames unplugged 10
echo 0x68 >"/sys/bus/i2c/devices/$bus/delete_device"
expect 'an error that names it' wait_for 10 logged 1 'error.*imu0: read .*No such device; no more samples come'
before=$(frame_count unplugged)
expect 'frames go on' wait_for 20 has_frames unplugged $((before + 20))
end_capture
expect 'its samples stay' [ "$(grep -vc '^#' "$(session_of unplugged)/imu0/data.csv")" -ge 50 ]
verdict 'iio: the device is gone, the frames go on'

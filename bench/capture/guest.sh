#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The first process of the virtual machine: captures with each program in turn, for two lengths of time,
# and takes the difference, so that what starting costs is not counted.
# shellcheck source=tests/vm/guest/setup.sh
. /share/setup.sh
export HOME=/tmp
modprobe vivid n_devs=1 node_types=0x1 num_inputs=1 input_types=0x00
until [ -e /dev/video0 ]; do sleep 0.2; done

short=10 long=40 # seconds

# cpu COMMAND...: user and system seconds of it and its children, to the file `cpu`.
cpu() { TIMEFORMAT='%U %S' && { time "$@" >out 2>&1; } 2>cpu; }

# Each captures SECONDS at WIDTH HEIGHT FPS and leaves the number of frames in `count`. All capture YUYV. The
# JPEG of orbbufd is gray, that of orbbufd_color and the others in colour.
orbbufd_captures() { orbbufd_captures_with source.format=YUYV jpeg.color=false "$@"; }
orbbufd_color_captures() { orbbufd_captures_with source.format=YUYV jpeg.color=true "$@"; }
orbbufd_captures_with() {
  local settings=(--set "$1" --set "$2")
  shift 2
  rm -rf frames
  orbbuf-server --set listen.address=127.0.0.1:7722 --set files.path=frames 2>server.log &
  local server=$!
  until grep -q listening server.log; do sleep 0.1; done
  cpu timeout -s TERM "$1" orbbufd --set robot.id=r --set source.kind=v4l2 "${settings[@]}" \
    --set "source.width=$2" --set "source.height=$3" --set "source.fps=$4" --set jpeg.quality=80
  kill "$server"
  wait "$server"
  cat frames/r/*/times.txt | wc -l >count
}
ustreamer_captures() {
  cpu timeout -s TERM "$1" ustreamer --device=/dev/video0 --format=YUYV "--resolution=$2x$3" \
    "--desired-fps=${4/12.5/13}" --encoder=CPU --workers=1 --quality=80 --port=8080 --log-level=2
  grep -ci 'compressed' out >count
}
gstreamer_captures() {
  local rate=$4/1
  [ "$4" = 12.5 ] && rate=25/2
  cpu timeout -s INT "$1" gst-launch-1.0 -e v4l2src device=/dev/video0 ! \
    "video/x-raw,format=YUY2,width=$2,height=$3,framerate=$rate" ! jpegenc quality=80 ! \
    multifilesink location=/tmp/gst-%d.jpg
  find /tmp -name 'gst-*.jpg' | wc -l >count
  rm -f /tmp/gst-*.jpg
}

# per_frame PROGRAM SIZE FPS: milliseconds of CPU a frame, or `none` if it captured nothing.
per_frame() {
  local program=$1 size=$2 fps=$3 seconds
  : >runs
  for seconds in $short $long; do
    "${program}_captures" "$seconds" "${size%x*}" "${size#*x}" "$fps"
    echo "$(cat cpu) $(cat count)" >>runs
  done
  awk 'NR == 1 { c = $1 + $2; n = $3 } NR == 2 { print ($3 > n ? 1000 * ($1 + $2 - c) / ($3 - n) : "none") }' runs
}

# ratio NAME PROGRAM BASELINE: of their costs; without one of them, the bench fails.
ratio() {
  awk -v name="$1" -v a="${cost[$2]}" -v b="${cost[$3]}" \
    'BEGIN { if (a + 0 > 0 && b + 0 > 0) printf "RESULT %s %.3f\n", name, a / b; else print "FAIL " name }'
}

# Once for nothing: programs come from the disk, and GStreamer fills its registry, which has to be
# told where its plugins are in a root whose /lib is no link.
export GST_REGISTRY=/tmp/gstreamer GST_PLUGIN_SYSTEM_PATH_1_0=/usr/lib/x86_64-linux-gnu/gstreamer-1.0
gst-inspect-1.0 v4l2src >out 2>&1 || cat out
orbbufd_captures $short 640 480 25
declare -A cost
for mode in 640x480@25 1280x720@12.5; do
  size=${mode%@*} fps=${mode#*@}
  for program in orbbufd orbbufd_color ustreamer gstreamer; do
    cost[$program]=$(per_frame $program "$size" "$fps")
    echo "capture: $size $program ${cost[$program]} ms of CPU a frame;" \
      "$(tail -n 1 runs | cut -d' ' -f3) frames in $long s"
    [ "${cost[$program]}" != none ] || tail -n 20 out
  done
  for baseline in ustreamer gstreamer; do
    ratio "capture.cpu_vs_$baseline.$size" orbbufd $baseline
    ratio "capture.cpu_color_vs_$baseline.$size" orbbufd_color $baseline
  done
done
echo DONE
sync
poweroff -f

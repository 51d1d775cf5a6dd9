# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# A USB camera, played by orbbuf-usb-camera: MJPG, and unplugging.

modprobe vhci-hcd
modprobe uvcvideo
given=/tmp/given # every JPEG that the camera gave away
mkdir $given

plug_in() {
  orbbuf-usb-camera "${1-$given}" "${@:2}" >usb.log 2>&1 &
  usb=$!
}

# Killed, it is unplugged; the port is free once the node has gone.
unplug() {
  kill $usb
  wait $usb
  wait_for 10 [ ! -e /dev/video0 ]
}

# same_bytes ROBOT: each of its images is one that the camera gave, and they are in that order.
same_bytes() {
  (cd $given && md5sum -- *.jpg) | cut -d' ' -f1 >given.md5
  (cd "$(session_of "$1")/images" && md5sum -- *.jpg) | cut -d' ' -f1 >taken.md5
  awk 'NR == FNR { place[$1] = NR; next }
    !($1 in place) || place[$1] <= last { bad = 1 }
    { last = place[$1] }
    END { exit bad }' given.md5 taken.md5
}

# row_is_whole ROBOT: the 100 images in a row are 100 in a row that the camera gave.
row_is_whole() {
  (cd "$(session_of "$1")/images" && xargs md5sum) <row.txt | cut -d' ' -f1 >row.md5
  grep -A 99 "$(head -n 1 row.md5)" given.md5 | cmp -s - row.md5
}

plug_in
expect 'a camera appears' wait_for 20 [ -e /dev/video0 ]
mode=(device=/dev/video0 width=320 height=240 fps=15)
capture mjpg "${mode[@]}" format=MJPG
expect '100 frames in a row at 15 fps' wait_for 60 has_row mjpg 15
end_capture
expect 'times increase' times_increase mjpg
expect 'byte for byte' same_bytes mjpg
expect 'none left out' row_is_whole mjpg
verdict 'USB MJPG: 100 frames in a row at 15 fps, none lost, byte for byte as the camera gave them'

capture yuyv "${mode[@]}"
expect 'YUYV by itself' wait_for 30 logged 1 'YUYV 320x240 px, 15 fps'
expect '20 frames' wait_for 30 has_frames yuyv 20
end_capture
verdict 'USB: uncompressed where that is fast enough'

capture plugged "${mode[@]}" format=MJPG
expect 'frames' wait_for 30 has_frames plugged 5
for cycle in {1..10}; do
  unplug
  expect "unplugged $cycle" wait_for 10 logged "$cycle" ': lost: '
  plug_in
  expect "plugged in $cycle" wait_for 20 logged "$cycle" ': recovered after '
done
before=$(frame_count plugged)
expect 'captures again' wait_for 10 has_frames plugged $((before + 5))
end_capture
expect 'one session' [ "$(find $frames/plugged -mindepth 1 -maxdepth 1 | wc -l)" = 1 ]
expect 'times increase' times_increase plugged
expect 'every frame accounted for' all_accounted
expect 'two lines for each' [ "$(grep -cE ': (lost: |recovered after )' "$log")" = 20 ]
verdict 'USB: ten times unplugged and plugged in again in one run'

capture bad "${mode[@]}" format=MJPG
expect 'frames' wait_for 30 has_frames bad 5
kill -STOP $usb
expect 'a camera that stands still is noticed' wait_for 10 logged 1 ': lost: no frame for '
kill -CONT $usb
expect 'and back' wait_for 20 logged 1 ': recovered after '
unplug
plug_in /tmp broken
expect 'broken images are counted' wait_for 30 logged 1 'failed [3-9][0-9] '
expect 'and not all logged' [ "$(grep -c 'JPEG is truncated' "$log")" -le 2 ]
unplug
plug_in
before=$(frame_count bad)
expect 'captures again' wait_for 20 has_frames bad $((before + 5))
end_capture
expect 'every frame accounted for' all_accounted
verdict 'USB: a camera that stands still, and one that gives broken images for ever'

# The pipeline that libcamera has for USB cameras is one that knows of unplugging; vimc's is not.
unplug
rm -f $given/*
plug_in
as=(env LD_PRELOAD=/share/orbbuf-usb-firmware-path.so)
mode=(kind=libcamera width=320 height=240 fps=15 format=MJPG)
capture whole "${mode[@]}"
expect '100 frames in a row at 15 fps' wait_for 60 has_row whole 15
end_capture
expect 'times increase' times_increase whole
expect 'byte for byte' same_bytes whole
expect 'none left out' row_is_whole whole
verdict 'libcamera USB MJPG: 100 frames in a row at 15 fps, none lost, byte for byte'

capture libcamera "${mode[@]}"
expect 'frames' wait_for 30 has_frames libcamera 5
first=$daemon
log=/tmp/refused.log
refuses 'another program uses the camera' "${mode[@]}"
log=/tmp/daemon.log
daemon=$first
for cycle in {1..3}; do
  unplug
  expect "unplugged $cycle" wait_for 10 logged "$cycle" ': lost: the camera is unplugged'
  plug_in
  expect "plugged in $cycle" wait_for 20 logged "$cycle" ': recovered after '
done
before=$(frame_count libcamera)
expect 'captures again' wait_for 10 has_frames libcamera $((before + 5))
kill -STOP $usb
expect 'a camera that stands still is noticed' wait_for 10 logged 1 ': lost: no frame for '
kill -CONT $usb
expect 'and back' wait_for 30 logged 4 ': recovered after '
end_capture
as=()
expect 'one session' [ "$(find $frames/libcamera -mindepth 1 -maxdepth 1 | wc -l)" = 1 ]
expect 'times increase' times_increase libcamera
expect 'every frame accounted for' all_accounted
expect 'two lines for each' [ "$(grep -cE ': (lost: |recovered after )' "$log")" = 8 ]
verdict 'libcamera: three times unplugged and plugged in again, and standing still, in one run'

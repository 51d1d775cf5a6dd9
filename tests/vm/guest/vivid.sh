# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# vivid: a camera in the kernel that has all formats but MJPG, and faults on demand.

width=320 height=180 fps=15
modprobe vivid n_devs=1 node_types=0x1 num_inputs=1 input_types=0x0
camera=/dev/video0
mode=("device=$camera" "width=$width" "height=$height" "fps=$fps")

for format in GREY NV12 YUV420 YUYV UYVY BGR24 RGB24; do
  capture "$format" "${mode[@]}" "format=$format"
  expect "100 frames in a row at $fps fps" wait_for 60 has_row "$format" $fps
  end_capture
  expect 'times increase' times_increase "$format"
  expect 'every frame accounted for' all_accounted
  image=$(session_of "$format")/images/$(tail -n 1 row.txt)
  expect "images of ${width}x$height" [ "$(size_of "$image")" = ${width}x$height ]
  verdict "vivid $format: 100 frames in a row at $fps fps, none lost"
done

for format in NV12 YUV420 YUYV UYVY; do
  color=true capture "color_$format" "${mode[@]}" "format=$format"
  expect '20 frames' wait_for 60 has_frames "color_$format" 20
  end_capture
  image=$(find "$frames/color_$format" -name '*.jpg' | sort | tail -n 1)
  expect "images of ${width}x$height" [ "$(size_of "$image")" = ${width}x$height ]
  expect 'colour' [ "$(components_of "$image")" = 3 ]
done
verdict 'vivid: NV12, YUV420, YUYV and UYVY in colour'

orbbufd --list-cameras >list.txt
expect 'name and bus' grep -qx '/dev/video0: vivid, platform:vivid-000' list.txt
expect 'sizes and rates' grep -qE '^  YUYV 320x180 \(.* fps\), .*, 1280x720 \(' list.txt
expect 'controls' grep -qx '  control brightness: 0 to 255, default 128' list.txt
settings=()
for setting in kind=v4l2 "${mode[@]}"; do settings+=(--set "source.$setting"); done
orbbufd --probe "${settings[@]}" >probe.txt 2>&1
expect 'rate and size' grep -qE '^captured: .* at 1[3-6][.0-9]* fps, 320x180 px$' probe.txt
sed '1,/^suggested:/d' probe.txt >suggested.toml
expect 'a suggestion that holds' orbbufd --check-config --config suggested.toml
cat list.txt probe.txt >"$log"
verdict 'vivid: --list-cameras and --probe'

# cause CONTROL...: presses vivid's buttons.
cause() {
  local control
  for control in "$@"; do v4l2-ctl -d $camera -c "$control=1"; done
}

# survives TEXT: for the TEXTth time the camera is lost, and then back, and captures again.
lost=0
survives() {
  local before
  lost=$((lost + 1))
  expect "$1: noticed" wait_for 10 logged $lost ': lost: '
  expect "$1: back" wait_for 20 logged $lost ': recovered after '
  before=$(frame_count faults)
  expect "$1: captures again" wait_for 10 has_frames faults $((before + 5))
}

capture faults "${mode[@]}" format=YUYV controls.brightness=100 controls.gain_automatic=false controls.gain=77
expect 'frames' wait_for 30 has_frames faults 10
expect 'brightness' [ "$(v4l2-ctl -d $camera -C brightness)" = 'brightness: 100' ]
expect 'gain, which was automatic' [ "$(v4l2-ctl -d $camera -C gain)" = 'gain: 77' ]
v4l2-ctl -d $camera -c percentage_of_dropped_buffers=50
expect 'missed frames are counted' wait_for 10 logged 1 'missed by the camera'
v4l2-ctl -d $camera -c percentage_of_dropped_buffers=0
cause inject_v4l2_buf_flag_error
expect 'a corrupt image is named' wait_for 10 logged 1 'marked the image as corrupt'
cause inject_vidioc_qbuf_error
survives 'failing QBUF'
cause inject_vidioc_reqbufs_error inject_fatal_streaming_error
survives 'failing REQBUFS'
cause inject_vidioc_streamon_error inject_fatal_streaming_error
survives 'failing STREAMON'
cause inject_fatal_streaming_error
survives 'fatal error'
cause disconnect
survives 'disconnect'
expect 'brightness is set again' [ "$(v4l2-ctl -d $camera -C brightness)" = 'brightness: 100' ]
end_capture
expect 'one session' [ "$(find $frames/faults -mindepth 1 -maxdepth 1 | wc -l)" = 1 ]
expect 'times increase' times_increase faults
expect 'every frame accounted for' all_accounted
expect "reopened $lost times" logged 1 "1 corrupt, reopened $lost times"
verdict 'vivid: every fault survived in one run'

# refuses TEXT SETTING...: the daemon does not start, and says why.
refuses() {
  local text=$1
  shift
  capture refused "$@"
  expect "exit status of: $text" ends_with 1
  expect "$text" logged 1 "$text"
  cat "$log" >>refusals.log
}

refuses 'cannot open camera /dev/video9: No such file or directory; this machine has /dev/video0' device=/dev/video9
refuses 'no GREY at 321x180; the camera offers' "${mode[@]}" width=321 format=GREY
refuses 'no MJPG at 320x180; the camera offers' "${mode[@]}" format=MJPG
refuses 'no control zoom_zoom; its controls: brightness' "${mode[@]}" controls.zoom_zoom=1
refuses 'control brightness: must be 0 to 255 in steps of 1 (default 128), got 256' "${mode[@]}" controls.brightness=256
refuses 'test_pattern: must be one of 0 75% Colorbar, ' "${mode[@]}" controls.test_pattern=99
refuses 'cannot crop its sensor to 64x64+0+0: its driver does not support cropping' "${mode[@]}" crop=64x64+0+0
as=(chroot --userspec=65534:65534 --groups=65534 /)
chmod 660 $camera
refuses 'Permission denied; add the user to group video' "${mode[@]}"
as=()
capture busy "${mode[@]}" format=GREY
expect 'frames' wait_for 30 has_frames busy 5
first=$daemon
refuses 'another program uses the camera' "${mode[@]}" format=GREY
daemon=$first
end_capture
modprobe -r vivid
modprobe vivid n_devs=1 node_types=0x100 # an output
refuses 'does not capture images' "${mode[@]}"
modprobe -r vivid
mv refusals.log "$log"
verdict 'what cannot be captured is refused by name'

# A part of the sensor: of vivid's webcam there is none, of its HDMI input there is.
modprobe vivid n_devs=1 node_types=0x1 num_inputs=1 input_types=0x3
capture crop "${mode[@]}" format=GREY crop=320x180+480+270
expect 'frames' wait_for 60 has_frames crop 20
v4l2-ctl -d $camera --get-selection target=crop >part.txt 2>&1
expect "the part, not $(cat part.txt)" grep -q 'Left 480, Top 270, Width 320, Height 180' part.txt
end_capture
first_image=$(find "$(session_of crop)/images" -name '*.jpg' | sort | head -n 1)
expect "images of ${width}x$height" [ "$(size_of "$first_image")" = ${width}x$height ]
capture all "${mode[@]}" format=GREY
expect 'frames' wait_for 60 has_frames all 5
v4l2-ctl -d $camera --get-selection target=crop >part.txt 2>&1
expect "all again, not $(cat part.txt)" grep -q 'Left 0, Top 0, Width 1280, Height 720' part.txt
end_capture
refuses 'cannot crop its sensor to 320x180+1200+0: its driver would use 320x180+960+0 of 1280x720+0+0' \
  "${mode[@]}" crop=320x180+1200+0
modprobe -r vivid
mv refusals.log "$log"
verdict 'vivid: a part of the sensor, and then all of it'

# Two cameras that start at moments of their own are a stereo pair all the same.
modprobe vivid n_devs=2 node_types=0x1,0x1 num_inputs=1,1 input_types=0x0,0x0
same_names() { # no diff <() <(): the guest has no /dev/fd
  [ "$(cd "$(session_of "$1")/images" && ls)" = "$(cd "$(session_of "$1")/images_right" && ls)" ]
}
camera=/dev/video1
capture stereo "${mode[@]}" format=GREY device_right=$camera
expect '50 pairs' wait_for 60 has_frames stereo 100
v4l2-ctl -d $camera -c percentage_of_dropped_buffers=50
expect 'images without a partner' wait_for 20 logged 1 'stereo: .* images without a partner within'
v4l2-ctl -d $camera -c percentage_of_dropped_buffers=0
cause disconnect
expect 'right camera: lost' wait_for 10 logged 1 "camera $camera: lost: "
expect 'right camera: back' wait_for 20 logged 1 "camera $camera .* recovered after "
before=$(frame_count stereo)
expect 'captures again' wait_for 20 has_frames stereo $((before + 20))
end_capture
expect 'times increase' times_increase stereo
expect 'every frame accounted for' all_accounted
expect 'two images of each frame' same_names stereo
expect 'the account' logged 1 'stereo: .* pairs, .* left and .* right images without a partner'
modprobe -r vivid
verdict 'vivid: two cameras as a stereo pair, one of them lost and back'

# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# vimc through libcamera: no gray, no rate. libcamera finds cameras by udev, and captures with them by an IPA module
# of its own. On Debian 12 (libcamera 0.0.3) only widths that can be divided by 6; on Debian 13 (0.4, Linux 6.12) the
# driver makes RGB24 alone, though libcamera also offers BGR24.
mode=(kind=libcamera width=192 height=144)
smallest=48x48 adjusted=198x150
if grep -qx 'VERSION_ID="13"' /etc/os-release; then
  mode+=(format=RGB24)
  smallest=16x16 adjusted=200x150
fi

/lib/systemd/systemd-udevd --daemon
modprobe vimc
udevadm settle
sensor=$(grep -lx 'Sensor B' /sys/class/video4linux/*/name)
sensor=/dev/$(basename "$(dirname "$sensor")")

orbbufd --list-cameras >list.txt 2>&1
expect 'place and id' grep -qxE 'libcamera 0: platform/vimc.0 Sensor B, .+' list.txt
expect 'sizes' grep -qx "  BGR24 $smallest to 4096x2160" list.txt
expect 'controls' grep -qE '^  control brightness: -1 to ' list.txt
cp list.txt "$log"
verdict 'libcamera: --list-cameras'

# in_row ROBOT: writes the names of 100 images one right after the other.
in_row() {
  awk '
    { length_ = NR > 1 && $1 == id + 1 && $2 > time ? length_ + 1 : 1; id = $1; time = $2 }
    length_ >= 100 { found = 1; for (i = id - 99; i <= id; ++i) printf "%06d.jpg\n", i; exit }
    END { exit !found }' "$(session_of "$1")/times.txt" >row.txt 2>/dev/null
}

capture vimc "${mode[@]}" camera=0 controls.brightness=0.25
expect '100 frames in a row' wait_for 60 in_row vimc
expect 'brightness' [ "$(v4l2-ctl -d "$sensor" -C brightness)" = 'brightness: 160' ]
end_capture
expect 'times increase' times_increase vimc
expect 'every frame accounted for' all_accounted
expect 'images of 192x144' [ "$(size_of "$(session_of vimc)/images/$(tail -n 1 row.txt)")" = 192x144 ]
expect 'none missed by the camera' logged 1 ' 0 missed by the camera, 0 corrupt, reopened 0 times'
verdict 'libcamera: 100 frames in a row, none lost'

capture adjusted kind=libcamera width=200 height=150 format=GREY 'camera=platform/vimc.0 Sensor B'
expect 'adjusted' wait_for 20 logged 1 "captures RGB24 $adjusted px instead of GREY 200x150 px"
expect 'frames' wait_for 30 has_frames adjusted 5
end_capture
expect 'size' [ "$(size_of "$(find $frames/adjusted -name '*.jpg' | head -n 1)")" = "$adjusted" ]
settings=()
for setting in "${mode[@]}"; do settings+=(--set "source.$setting"); done
orbbufd --probe "${settings[@]}" >probe.txt 2>&1
expect 'rate and size' grep -qE '^captured: .* fps, 192x144 px$' probe.txt
sed '1,/^suggested:/d' probe.txt >suggested.toml
expect 'a suggestion that holds' orbbufd --check-config --config suggested.toml
cat probe.txt >>"$log"
verdict 'libcamera: as adjusted, and --probe'

refuses 'libcamera has no camera 1: this machine has 0: platform/vimc.0 Sensor B' "${mode[@]}" camera=1
refuses 'no control zoom; its controls: brightness, ' "${mode[@]}" controls.zoom=1
refuses 'control brightness: must be -1 to .*, got 7' "${mode[@]}" controls.brightness=7
capture taken "${mode[@]}"
expect 'frames' wait_for 30 has_frames taken 5
first=$daemon
log=/tmp/refused.log
refuses 'no camera that it can open; it may hide a camera that another program uses' "${mode[@]}"
log=/tmp/daemon.log
daemon=$first
end_capture
cat "$log" >>refusals.log
chmod 660 /dev/media* /dev/video*
as=(chroot --userspec=65534:65534 --groups=65534 /)
refuses 'Permission denied; add the user to group video' "${mode[@]}"
as=()
mv refusals.log "$log"
verdict 'libcamera: what cannot be captured is refused by name'

modprobe -r vimc

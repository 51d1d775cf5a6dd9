#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# First process of the arm64 machine, which leaves to systemd; then what systemd runs when it is up.
if [ $$ -eq 1 ]; then
  cat >/etc/systemd/system/cases.service <<'UNIT'
[Unit]
After=multi-user.target
[Service]
Type=oneshot
ExecStart=/bin/bash /share/guest.sh
ExecStopPost=/bin/systemctl poweroff -ff
StandardOutput=file:/dev/console
StandardError=file:/dev/console
UNIT
  mkdir -p /etc/systemd/system/multi-user.target.wants
  ln -s ../cases.service /etc/systemd/system/multi-user.target.wants/
  ln -s /lib/systemd/system/multi-user.target /etc/systemd/system/default.target
  ln -s /dev/null /etc/systemd/system/serial-getty@ttyAMA0.service
  exec /lib/systemd/systemd
fi

# check WORDS COMMAND...
check() {
  local words=$1
  shift
  if "$@" >/tmp/said 2>&1; then echo "PASS $words"; else
    echo "FAIL $words: $*"
    cat /tmp/said
  fi
}
frames=/var/lib/private/orbbuf-server/robot
state() { [ "$(systemctl is-active orbbufd):$(systemctl is-enabled orbbufd)" = "$1" ]; }
# delivered N: waits for N frames in the server's record, for 120 s.
delivered() {
  local second
  for ((second = 0; second < 120; ++second)); do
    [ "$(cat $frames/*/times.txt 2>/dev/null | wc -l)" -lt "$1" ] || return 0
    sleep 1
  done
  return 1
}
# account: every frame that the robot says it captured is delivered or dropped, once.
account() {
  journalctl -u orbbufd | sed -n 's/.*session ended: captured \([0-9]*\) .*/\1/p' >/tmp/captured
  [ "$(cat /tmp/captured)" -ge 50 ] || return 1
  { cut -d' ' -f1 $frames/*/times.txt; sed 1d $frames/*/drops.csv | cut -d, -f1; } | sort -n >/tmp/known
  seq 0 $(($(cat /tmp/captured) - 1)) | diff - /tmp/known
}

echo "guest: up after $(cut -d' ' -f1 /proc/uptime) s"
modprobe vivid n_devs=1 node_types=0x1 num_inputs=1 input_types=0x0
udevadm settle
ip link set lo up 2>/dev/null || busybox ifconfig lo up
check 'the camera is there' test -e /dev/video0
check 'the packages install' dpkg --force-depends -i /share/orbbufd_*.deb /share/orbbuf-server_*.deb
check 'nothing starts before it is configured' state inactive:disabled
LIBCAMERA_LOG_LEVELS='*:DEBUG' orbbufd --list-cameras >/tmp/cameras 2>&1
grep -E '^/dev|^libcamera|rpi|ipa_' /tmp/cameras
check 'orbbufd lists the camera' grep -q '^/dev/video0: vivid' /tmp/cameras
if [[ $(echo /share/orbbufd_*) == *~deb13u* ]]; then
  check "libcamera has the Raspberry Pi's pipeline" grep -q 'rpi/vc4' /tmp/cameras
fi
sed -i 's/^width = 640 /width = 320 /; s/^height = 480 /height = 180 /; s/^fps = 25.0/fps = 10.0/' /etc/orbbuf/orbbufd.toml
check 'systemd starts the server' systemctl start orbbuf-server
check 'systemd starts the robot' systemctl start orbbufd
check 'its frames arrive' delivered 50
systemctl status --no-pager orbbufd orbbuf-server
echo "RESULT ship.rss_mib.320x180.arm64 $(($(awk '/VmHWM/ {print $2}' "/proc/$(systemctl show -p MainPID --value orbbufd)/status") / 1024))"
check 'systemd stops the robot' systemctl stop orbbufd
check 'each frame is delivered or named' account
systemctl enable -q orbbufd
check 'the package is removed' dpkg --force-depends -r orbbufd
check 'and purged' dpkg --force-depends -P orbbufd
check 'nothing of it is left' test -z "$(find /bin /etc /lib /sbin /usr /var/lib/systemd -name '*orbbufd*')"
journalctl --no-pager -b -u orbbufd -u orbbuf-server | tail -n 40
echo "DONE after $(cut -d' ' -f1 /proc/uptime) s"

#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The first and only process of the virtual machine: sets it up, runs the cases, powers it off.
exec </dev/null >/dev/console 2>&1
export PATH=/bin:/sbin:/usr/bin:/usr/sbin:/tmp/bin
busybox mount -t tmpfs tmpfs /tmp
busybox mount -t tmpfs tmpfs /run
mkdir /tmp/bin
busybox --install -s /tmp/bin
cp /share/orb* /tmp/bin/
ip link set lo up
cd /tmp || exit
echo # the boot loader's line is not ended
# shellcheck source=tests/vm/guest/cases.sh
. /share/cases.sh
start_server
# shellcheck source=tests/vm/guest/vivid.sh
. /share/vivid.sh
# shellcheck source=tests/vm/guest/libcamera.sh
. /share/libcamera.sh
# shellcheck source=tests/vm/guest/usb.sh
. /share/usb.sh
echo "DONE after $(cut -d' ' -f1 /proc/uptime) s"
sync
poweroff -f

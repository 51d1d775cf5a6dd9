#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The first and only process of the virtual machine: sets it up, runs the cases, powers it off.
# shellcheck source=tests/vm/guest/setup.sh
. /share/setup.sh
# shellcheck source=tests/vm/guest/cases.sh
. /share/cases.sh
start_server
# shellcheck source=tests/vm/guest/vivid.sh
. /share/vivid.sh
# shellcheck source=tests/vm/guest/libcamera.sh
. /share/libcamera.sh
# shellcheck source=tests/vm/guest/iio.sh
. /share/iio.sh
# shellcheck source=tests/vm/guest/usb.sh
. /share/usb.sh
echo "DONE after $(cut -d' ' -f1 /proc/uptime) s"
sync
poweroff -f

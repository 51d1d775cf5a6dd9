# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# To be sourced by the first process of a virtual machine: the console, the programs of /share, temporary folders
# in memory, the network.
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

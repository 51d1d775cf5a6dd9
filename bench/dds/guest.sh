#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The first process of the virtual machine: the kernel's simulated camera, captured by orbbufd, against a ROS 2 topic.
# shellcheck source=tests/vm/guest/setup.sh
. /share/setup.sh
export HOME=/tmp ORBBUF_OWN_NAMESPACE=1
modprobe -a vivid veth nf_tables
until [ -e /dev/video0 ]; do sleep 0.2; done
mkdir -p /dev/shm build/{daemon,server,bench}
ln -s /share/orbbufd build/daemon
ln -s /share/orbbuf-server build/server
ln -s /share/orbbuf-dds-* build/bench
# shellcheck disable=SC2046 # words
bash /share/sources.sh build --device /dev/video0 $(cat /share/options) && echo DONE
sync
poweroff -f

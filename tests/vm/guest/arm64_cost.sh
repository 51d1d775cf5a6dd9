#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# First process of the machine whose clock counts instructions: what a frame costs, in millions of them,
# which is what --probe takes for milliseconds.
exec </dev/null >/dev/console 2>&1
export PATH=/bin:/sbin:/usr/bin:/usr/sbin
busybox mount -t tmpfs tmpfs /tmp
echo
dpkg-deb -x /share/orbbufd_*.deb /tmp
for size in 640x480 1280x960; do
  said=$(/tmp/usr/bin/orbbufd --set source.width=${size%x*} --set source.height=${size#*x} --set source.fps=5 --probe)
  echo "$said"
  jpeg=$(sed -n 's/^JPEG: \([0-9.]*\) ms.*/\1/p' <<<"$said")
  orb=$(sed -n 's/^ORB.*: \([0-9.]*\) ms.*/\1/p' <<<"$said")
  if [ -n "$jpeg" ] && [ -n "$orb" ]; then
    echo "RESULT ship.minstr.jpeg.$size $jpeg"
    echo "RESULT ship.minstr.orb.$size $orb"
  else
    echo "FAIL --probe at $size tells no cost"
  fi
done
echo "DONE after $(cut -d' ' -f1 /proc/uptime) s"
poweroff -f 2>/dev/null || busybox poweroff -f

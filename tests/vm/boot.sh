#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Boots the virtual machine that image.sh has made in FOLDER, with the folder SHARE, whose guest.sh is
# its first process; prints what that prints, until it powers off. Or boots DISK, which is changed by
# that, with its own first process; RECORD is a folder of this machine that it can write to, and SLOW a
# second disk, which takes 1 MB/s. Usage: tests/vm/boot.sh FOLDER SHARE [DISK RECORD SLOW]
set -euo pipefail
if [ $# -gt 2 ]; then
  disk=("file=$3,if=virtio,format=raw,cache=unsafe" -virtfs "local,path=$4,mount_tag=record,security_model=mapped-xattr"
    -drive "file=$5,if=virtio,format=raw,cache=unsafe,throttling.bps-write=1000000")
  append='init=/sbin/init systemd.show_status=0'
  for unit in serial-getty@ttyS0.service getty@tty1.service apt-daily.timer apt-daily-upgrade.timer; do
    append+=" systemd.mask=$unit"
  done
else
  disk=("file=$1/root.ext4,if=virtio,format=raw,snapshot=on")
  append=init=/share/guest.sh
fi
# Not KVM, which not every machine has; a CPU for which OpenCV picks no code that is slow to emulate.
timeout --foreground 900 qemu-system-x86_64 -accel tcg,thread=multi -cpu Nehalem -smp 2 -m 1536 \
  -nodefaults -no-reboot -nographic -serial stdio -nic none \
  -kernel "$1/kernel" -initrd "$1/initrd.gz" -append "console=ttyS0 quiet panic=-1 mitigations=off $append" \
  -drive "${disk[@]}" \
  -virtfs "local,path=$2,mount_tag=share,security_model=none,readonly=on" </dev/null 2>&1 |
  stdbuf -oL tr -d '\r'

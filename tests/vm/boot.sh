#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Boots the virtual machine that image.sh has made in FOLDER, with the folder SHARE, whose guest.sh is
# its first process; prints what that prints, until it powers off. Usage: tests/vm/boot.sh FOLDER SHARE
set -euo pipefail
# Not KVM, which not every machine has; a CPU for which OpenCV picks no code that is slow to emulate.
timeout --foreground 900 qemu-system-x86_64 -accel tcg,thread=multi -cpu Nehalem -smp 2 -m 1536 \
  -nodefaults -no-reboot -nographic -serial stdio -nic none \
  -kernel "$1/kernel" -initrd "$1/initrd.gz" -append 'console=ttyS0 quiet panic=-1 mitigations=off' \
  -drive "file=$1/root.ext4,if=virtio,format=raw,snapshot=on" \
  -virtfs "local,path=$2,mount_tag=share,security_model=none,readonly=on" </dev/null 2>&1 |
  tr -d '\r'

# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# What the virtual machines are made of, for the scripts that make them.

# shellcheck source=toolchain/sources.sh
. "$(dirname "${BASH_SOURCE[0]}")/../../toolchain/sources.sh"

# For mmdebstrap: nothing that is only read by people.
# shellcheck disable=SC2034 # used by who sources this
SLIM=(--dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/man/*'
  --dpkgopt='path-exclude=/usr/share/locale/*')

# own_sources: the files that say where this machine has its packages from.
own_sources() { ls -d /etc/apt/sources.list /etc/apt/sources.list.d/*.{list,sources} 2>/dev/null; }

# modules ROOT NAME...: the files that have to be loaded for these, in the order of loading.
modules() {
  local root=$1 name
  shift
  for name in "$@"; do
    modprobe -d "$root" -S "$(ls "$root/lib/modules")" --show-depends "$name"
  done | awk '$1 == "insmod" && !seen[$2]++ {print $2}'
}

# initrd ROOT INIT: makes initrd.gz with INIT, busybox, and what it takes to mount a disk and a folder.
initrd() {
  rm -rf initrd
  mkdir -p initrd/{bin,dev,proc,sys,new}
  cp "$1/bin/busybox" initrd/bin/
  cp "$2" initrd/init
  modules "$1" virtio_pci virtio_blk ext4 9p 9pnet_virtio | while read -r file; do
    cp "$file" initrd/
    basename "$file" >>initrd/modules
  done
  (cd initrd && find . | cpio --quiet -o -H newc | gzip -1) >initrd.gz
  rm -rf initrd
}

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes the virtual machine's parts in FOLDER: kernel, initrd.gz and root.ext4, a Debian just large
# enough, with the libraries that PROGRAMs need. The packages come from this machine's own sources.
# What is there already, and still right, is kept. Usage: tests/vm/image.sh FOLDER PROGRAM...
# $VM_PACKAGES: further packages, separated by commas; $VM_MODULES: further modules of the kernel.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=tests/vm/parts.sh
. "$here/parts.sh"
folder=$1
shift
PACKAGES=busybox-static,bash,kmod,udev,v4l-utils,libcamera-ipa,linux-image-amd64${VM_PACKAGES:+,$VM_PACKAGES}
read -ra MODULES <<<"vivid uvcvideo vhci-hcd vimc i2c-dev i2c-stub bmi160_i2c iio-trig-hrtimer ${VM_MODULES-}"
mkdir -p "$folder"
cd "$folder"

mapfile -t sources < <(own_sources)

# keep STAMP FILE...: whether FILEs were made from what STAMP says; if not, they are removed.
keep() {
  local stamp=$1
  shift
  [ ! -e "$1" ] || [ "$(cat "$1.stamp" 2>/dev/null)" != "$stamp" ] || return 0
  rm -rf "$@"
  return 1
}

debian() {
  local stamp
  stamp=$(echo "$PACKAGES" | cat - "${sources[@]}" | sha256sum)
  ! keep "$stamp" debian || return 0
  mmdebstrap --quiet --variant=extract --include="$PACKAGES" \
    "${SLIM[@]}" "$(own_release)" debian "${sources[@]}"
  echo "$stamp" >debian.stamp
}

# What is in Debian's kernel's source but not in its package: vimc, the camera that libcamera knows, and the trigger of
# IIO that is a timer. Since 0.1 libcamera has vimc's sensor film in full and scales that down; all of 1920x1080 would take
# an emulated processor a second.
own_modules() {
  local source cameras triggers headers=/usr/src/linux-headers-$version
  source=linux-source-$(cut -d. -f1,2 <<<"$version")
  cameras=$source/drivers/media/test-drivers/vimc triggers=$source/drivers/iio
  [ -d "$headers" ] || { echo "vm: apt-get install linux-headers-$version, to build modules" >&2 && exit 1; }
  tar -xf "/usr/src/$source.tar.xz" --wildcards "$cameras/*" "$triggers"/industrialio-{configfs,sw-trigger}.c \
    "$triggers/trigger/iio-trig-hrtimer.c"
  sed -i 's/\(define VIMC_FRAME_MAX_WIDTH\).*/\1 640/; s/\(define VIMC_FRAME_MAX_HEIGHT\).*/\1 480/' "$cameras"/*.h
  echo 'obj-m := industrialio-configfs.o industrialio-sw-trigger.o trigger/iio-trig-hrtimer.o' >"$triggers/Kbuild"
  if ! make -s -C "$headers" M="$PWD/$cameras" CONFIG_VIDEO_VIMC=m -j"$(nproc)" modules >modules.log 2>&1 ||
    ! make -s -C "$headers" M="$PWD/$triggers" modules >>modules.log 2>&1; then
    cat modules.log >&2
    exit 1
  fi
  mkdir -p "debian/lib/modules/$version/extra"
  find "$source" -name '*.ko' | while read -r module; do
    strip -g -o "debian/lib/modules/$version/extra/$(basename "$module")" "$module"
  done
  rm -rf "$source"
}

# What the programs are linked to and Debian's root does not have.
libraries() {
  local file
  ldd "$@" | awk '$2 == "=>" && !seen[$3]++ {print $3}' | while read -r file; do
    [ -e "root/lib/x86_64-linux-gnu/$(basename "$file")" ] ||
      cp -L "$file" root/lib/x86_64-linux-gnu/
  done
}

root() {
  rm -rf root
  mkdir root
  tar -C debian --exclude=./lib/modules --exclude=./boot --exclude='./var/*' -c . | tar -C root -x
  mkdir -p root/{share,proc,sys,dev,tmp,run} "root/lib/modules/$version"
  ln -sf bash root/bin/sh
  cp "debian/lib/modules/$version"/modules.{builtin*,order} "root/lib/modules/$version/"
  modules "$PWD/debian" "${MODULES[@]}" | xargs cp -t "root/lib/modules/$version"
  depmod -b "$PWD/root" "$version"
  libraries "$@"
  mke2fs -q -t ext4 -O ^has_journal -d root root.ext4 \
    "$(($(du -sm root | cut -f1) * 5 / 4 + 40))M" >/dev/null
  rm -rf root
}

debian
version=$(ls debian/lib/modules)
if [ ! -e "debian/lib/modules/$version/modules.dep" ]; then
  own_modules
  depmod -b "$PWD/debian" "$version"
fi
stamp=$(ldd "$@" | awk '$2 == "=>" {print $3}' | sort -u | xargs stat -L -c '%n %s %Y' |
  cat - debian.stamp "$here/image.sh" "$here/parts.sh" "$here/init" | sha256sum)
keep "$stamp" root.ext4 && exit
cp "debian/boot/vmlinuz-$version" kernel
initrd "$PWD/debian" "$here/init"
root "$@"
echo "$stamp" >root.ext4.stamp

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the arm64 packages in FOLDER in a virtual machine with 1 GB, as a Raspberry Pi 3 has: systemd
# starts the programs, and orbbufd streams the kernel's simulated camera to orbbuf-server. Then a second
# one, whose clock counts a nanosecond for each instruction, tells what a frame costs. A line for each
# case, PASS or FAIL; all of it is in build/vm-arm64/console.log. Usage: tests/vm/arm64.sh FOLDER
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=tests/vm/parts.sh
. "$here/parts.sh"
packages=$(cd "$1" && pwd)
vm=$here/../../build/vm-arm64
mkdir -p "$vm"
cd "$vm"

# The root is unpacked and not configured: nothing of another architecture need run here for that.
programs=$(for deb in "$packages"/orbbufd_*.deb "$packages"/orbbuf-server_*.deb; do dpkg-deb -f "$deb" Depends; done |
  sed 's/([^)]*)//g; s/, */\n/g' | tr -d ' ' | sort -u | paste -sd,)
INCLUDE=busybox-static,bash,coreutils,dpkg,diffutils,findutils,grep,libc-bin,sed,mawk,tar,kmod,mount,util-linux,login,dbus
INCLUDE+=,init-system-helpers,perl-base,systemd,udev,libcamera-ipa,linux-image-arm64,$programs
lines=$(debian_sources "$(own_release)")
mapfile -t sources <<<"$lines"

# What the packages' own scripts would have done to the root in $1.
set_up() {
  printf '%s\n' root:x:0:0:root:/root:/bin/bash messagebus:x:100:101::/nonexistent:/usr/sbin/nologin \
    nobody:x:65534:65534::/nonexistent:/usr/sbin/nologin >"$1/etc/passwd"
  printf '%s\n' root:x:0: tty:x:5: disk:x:6: kmem:x:15: dialout:x:20: cdrom:x:24: tape:x:26: audio:x:29: utmp:x:43: \
    video:x:44: systemd-journal:x:102: messagebus:x:101: render:x:103: input:x:104: kvm:x:105: sgx:x:106: \
    nogroup:x:65534: >"$1/etc/group"
  printf 'passwd: files systemd\ngroup: files systemd\nhosts: files\n' >"$1/etc/nsswitch.conf"
  echo '127.0.0.1 localhost' >"$1/etc/hosts"
  echo robot >"$1/etc/hostname"
  : >"$1/etc/machine-id"
  : >"$1/var/lib/dpkg/status"
  mkdir -p "$1/share" "$1/var/lib/dpkg/info"
  ln -sf bash "$1/bin/sh"
  ln -sf mawk "$1/usr/bin/awk"
  ln -sf lapack/liblapack.so.3 blas/libblas.so.3 "$1/usr/lib/aarch64-linux-gnu/"
  rm -rf "${1:?}"/boot/* "$1"/var/cache/apt/* "$1"/var/lib/apt/lists/*
}

make_image() {
  local version
  rm -rf debian
  mmdebstrap --quiet --variant=extract --architectures=arm64 --include="$INCLUDE" \
    "${SLIM[@]}" "$(own_release)" debian "${sources[@]}"
  version=$(ls debian/lib/modules)
  depmod -b "$PWD/debian" "$version"
  cp "debian/boot/vmlinuz-$version" kernel
  initrd "$PWD/debian" "$here/init"
  # Of the kernel's modules only what the camera and the link need.
  modules "$PWD/debian" vivid | xargs cp -t .
  rm -rf debian/lib/modules
  mkdir -p "debian/lib/modules/$version"
  mv ./*.ko* "debian/lib/modules/$version"
  depmod -b "$PWD/debian" "$version" 2>/dev/null
  set_up debian
  mke2fs -q -t ext4 -O ^has_journal -d debian root.ext4 "$(($(du -sm debian | cut -f1) * 5 / 4 + 60))M" >/dev/null
  rm -rf debian
}

# boot GUEST [OPTION...]: with GUEST, of tests/vm/guest, as the first process.
boot() {
  local guest=$1
  shift
  rm -rf share
  mkdir share
  cp "$packages"/orbbufd_*.deb "$packages"/orbbuf-server_*.deb "$here"/guest/arm64*.sh share/
  mv "share/$guest" share/guest.sh
  timeout --foreground 900 qemu-system-aarch64 -M virt -cpu cortex-a53 -m 1024 -nodefaults -no-reboot -nographic \
    -serial stdio -nic none -kernel kernel -initrd initrd.gz -append 'console=ttyAMA0 quiet panic=-1 mitigations=off init=/share/guest.sh' \
    -drive file=root.ext4,if=virtio,format=raw,snapshot=on \
    -virtfs local,path=share,mount_tag=share,security_model=none,readonly=on "$@" </dev/null 2>&1 |
    tr -d '\r' | tee -a console.log | grep --line-buffered -E '^(PASS|FAIL|RESULT|DONE) ' || true
}

stamp=$(printf '%s\n' "$INCLUDE" "${sources[@]}" | cat - "$here/arm64.sh" "$here/parts.sh" "$here/init" | sha256sum)
if [ "$(cat stamp 2>/dev/null)" != "$stamp" ]; then
  make_image
  echo "$stamp" >stamp
fi
: >console.log
boot arm64.sh -accel tcg,thread=multi -smp 2
boot arm64_cost.sh -accel tcg,thread=single -icount shift=0,sleep=off
[ "$(grep -c '^DONE ' console.log)" -eq 2 ] && ! grep -q '^FAIL ' console.log && exit
echo "test-vm arm64: failed; see $vm/console.log" >&2
exit 1

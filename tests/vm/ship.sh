#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The packages in a Debian that boots systemd, in a virtual machine: installed, configured, started
# without camera and server, killed, stopped, upgraded, without power, with a slow disk, purged. One line for each case,
# PASS or FAIL; what the guest printed is in BUILD/../vm/ship/console.log. Then, from what the server
# wrote, where every frame is. Usage: tests/vm/ship.sh BUILD PACKAGES
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=tests/vm/parts.sh
. "$here/parts.sh"
build=$(cd "$1" && pwd)
vm=$build/../vm
packages=("$(cd "$2" && pwd)"/{orbbufd,orbbuf-server}_*.deb)

# The kernel and its modules are those of the capture tests.
"$here/image.sh" "$vm" "$build/daemon/orbbufd" "$build/server/orbbuf-server"
vm=$(cd "$vm" && pwd)
mkdir -p "$vm/ship"
cd "$vm/ship"

# A Debian with what the packages need, and nothing of ours.
bare() {
  local needed stamp
  needed=$(for package in "${packages[@]}"; do dpkg-deb -f "$package" Depends; done |
    tr ',' '\n' | awk 'NF && !seen[$1]++ { printf "%s%s", (n++ ? "," : ""), $1 }')
  stamp=$({ echo "$needed" && declare -f bare; } | sha256sum)
  [ "$(cat bare.stamp 2>/dev/null)" != "$stamp" ] || return 0
  rm -rf bare bare.stamp
  local sources
  mapfile -t sources < <(own_sources)
  mmdebstrap --quiet --variant=apt --include="systemd-sysv,dbus,udev,kmod,busybox-static,libcamera-ipa,$needed" \
    "${SLIM[@]}" "$(own_release)" bare "${sources[@]}"
  mkdir bare/share
  echo 0123456789abcdef0123456789abcdef >bare/etc/machine-id
  echo ship >bare/etc/hostname
  echo 'record /var/lib/private/orbbuf-server 9p trans=virtio,version=9p2000.L,msize=512000 0 0' >bare/etc/fstab
  mkdir -p bare/var/lib/private/orbbuf-server
  chmod 700 bare/var/lib/private
  cat >bare/etc/systemd/system/ship.service <<'UNIT'
[Service]
ExecStart=/share/ship.sh
[Install]
WantedBy=multi-user.target
UNIT
  ln -s ../ship.service bare/etc/systemd/system/multi-user.target.wants/ship.service
  echo "$stamp" >bare.stamp
}

# disk: the bare root, and the cameras' modules.
disk() {
  local version modules
  version=$(ls "$vm/debian/lib/modules")
  modules=bare/lib/modules/$version
  rm -rf "$modules"
  mkdir -p "$modules"
  cp "$vm/debian/lib/modules/$version"/modules.{builtin*,order} "$modules/"
  modules "$vm/debian" vivid vimc | xargs cp -t "$modules"
  depmod -b "$PWD/bare" "$version"
  mke2fs -q -t ext4 -F -d bare disk.ext4 "$(($(du -sm bare | cut -f1) * 5 / 4 + 100))M" >/dev/null
}

# keys: as docs/security.md has them.
keys() {
  local name key
  mkdir share/keys
  cd share/keys
  openssl req -x509 -new -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj '/CN=CA' \
    -keyout ca.key -out ca.crt
  for key in server turtlebot1 front slow; do
    name=/CN=$key
    openssl req -new -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj "$name" \
      -addext 'subjectAltName=IP:127.0.0.1' -keyout $key.key -out $key.csr
    openssl x509 -req -in $key.csr -copy_extensions copy -days 2 -CA ca.crt -CAkey ca.key -out $key.crt
  done
  cd ../..
}

# newer: the same packages by a later version.
newer() {
  local package
  mkdir share/newer
  for package in "${packages[@]}"; do
    rm -rf unpacked
    dpkg-deb -R "$package" unpacked
    sed -i 's/^Version: .*/&+newer/' unpacked/DEBIAN/control
    dpkg-deb --root-owner-group -b unpacked share/newer >/dev/null
  done
}

bare
disk
rm -rf share record
mkdir share record
cp "${packages[@]}" "$here"/guest/{cases,ship}.sh share/
keys >/dev/null 2>&1
newer
rm -f slow.ext4 # for a spool
mke2fs -q -t ext4 -F slow.ext4 200M >/dev/null
start=$SECONDS
: >console.log
for _ in before after; do # the power cut
  "$here/boot.sh" "$vm" "$PWD/share" "$PWD/disk.ext4" "$PWD/record" "$PWD/slow.ext4" | tee -a console.log |
    grep --line-buffered -E '^(PASS|FAIL|DONE|RESULT) ' || true
done
"$here/record.sh" record | tee -a console.log
echo "ship: two boots took $((SECONDS - start)) s"
if grep -q '^DONE ' console.log && ! grep -q '^FAIL ' console.log; then exit 0; fi
echo "test-vm ship: failed; see $PWD/console.log" >&2
exit 1

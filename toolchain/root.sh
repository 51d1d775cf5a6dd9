#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A Debian of its own in a folder. Takes root.
#   root.sh make RELEASE FOLDER   makes one of Debian's essential packages and apt (20 s, 300 MB)
#   root.sh run FOLDER [-b FROM TO]... COMMAND...
#                                 runs a command in it, as on a machine: / and /run are mounted, /proc, /sys and /dev
#                                 are there, and this machine's folders FROM as TO; the network is this machine's.
#                                 Processes and mounts go when it ends
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=toolchain/sources.sh
. "$here/sources.sh"

make() {
  local release=$1 folder=$2 lines sources
  lines=$(debian_sources "$release")
  mapfile -t sources <<<"$lines"
  mmdebstrap --quiet --variant=minbase "$release" "$folder" "${sources[@]}"
  # How this machine reaches them, if through a proxy.
  apt-config dump | grep -iE '^Acquire::.*proxy' >"$folder/etc/apt/apt.conf.d/proxy" || true
}

# inside FOLDER [-b FROM TO]... COMMAND...: in namespaces of its own. This shell stays, to reap what the command leaves.
inside() {
  cd "$1"
  shift
  mount --bind . .
  cd "$PWD"
  mount -t proc proc proc
  mount --rbind /sys sys
  mount --rbind /dev dev
  mount -t devpts -o newinstance,ptmxmode=0666,mode=0620,gid=5 devpts dev/pts
  mount -t tmpfs tmpfs dev/shm
  mount -t tmpfs -o mode=0755 tmpfs run
  while [ "$1" = -b ]; do
    mkdir -p "./$3"
    mount --bind "$2" "./$3"
    shift 3
  done
  pivot_root . mnt
  cd /
  umount -l mnt
  env -i HOME=/root LANG=C.UTF-8 PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$@"
}

[ "$(id -u)" -eq 0 ] || { echo 'root.sh: this takes root' >&2 && exit 1; }
case ${1-} in
  make) make "$2" "$3" ;;
  run) exec unshare --mount --propagation private --pid --fork --kill-child --ipc --uts "$here/root.sh" inside "${@:2}" ;;
  inside) inside "${@:2}" ;;
  *) sed -n '3,9s/^# //p' "${BASH_SOURCE[0]}" >&2 && exit 2 ;;
esac

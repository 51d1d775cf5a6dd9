#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes FOLDER, what a program for ARCHITECTURE (arm64 or armhf) is compiled and linked against: Debian's
# packages, from this machine's own sources, unpacked and not configured (about a minute, 550 MB). With
# them goes a package database, so that dpkg-shlibdeps finds what a program depends on. A folder that is
# there already, and was made from the same list, is kept. Usage: toolchain/sysroot.sh ARCHITECTURE FOLDER
set -euo pipefail
architecture=$1
folder=$2
case $architecture in
  arm64) triplet=aarch64-linux-gnu ;;
  armhf) triplet=arm-linux-gnueabihf ;;
  *) echo "sysroot.sh: arm64 or armhf, not $architecture" >&2 && exit 2 ;;
esac
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=toolchain/sources.sh
. "$here/sources.sh"

# library PACKAGE NAME: the library of a release's own version, such as NAME406, on which PACKAGE depends.
library() { apt-cache depends "$1" | sed -n "s/^ *Depends: \($2[0-9.]*[a-z0-9]*\)\$/\1/p" | head -n 1; }

compiler=$(g++ -dumpversion)
PACKAGES=(libc6-dev "libstdc++-${compiler%%.*}-dev" linux-libc-dev zlib1g-dev libssl-dev libboost-dev libspdlog-dev
  libfmt-dev libcli11-dev libtomlplusplus-dev nlohmann-json3-dev libjpeg62-turbo-dev libcamera-dev libsystemd-dev libgtest-dev
  libgmock-dev libopencv-core-dev libopencv-imgproc-dev libopencv-flann-dev
  "$(library libopencv-features2d-dev libopencv-features2d)" "$(library prometheus-cpp-dev libprometheus-cpp-core)" libyaml-cpp-dev)
# Unpacked without what they depend on: ORB needs none of that, and it is a desktop's worth; nor does the text
# of metrics need a web server.
ALONE=(libopencv-features2d-dev prometheus-cpp-dev)

lines=$(debian_sources "$(own_release)")
mapfile -t sources <<<"$lines"

# database ROOT: what dpkg would know had it installed the packages. Files are listed by the path they
# have here, which is the one that dpkg-shlibdeps asks for.
database() {
  local root info deb name id
  root=$(realpath "$1")
  info=$root/var/lib/dpkg/info
  mkdir -p "$info"
  : >"$root/var/lib/dpkg/status"
  echo 1 >"$info/format" # of the files' names
  for deb in "$root"/var/cache/apt/archives/*.deb; do
    name=$(dpkg-deb -f "$deb" Package)
    id=$name
    [ "$(dpkg-deb -f "$deb" Multi-Arch)" != same ] || id=$name:$architecture
    # shellcheck disable=SC2016 # dpkg-query's variables
    { dpkg-deb --show --showformat='Package: ${Package}\nStatus: install ok installed\n' "$deb"
      dpkg-deb -f "$deb" Maintainer Architecture Multi-Arch Version Depends Provides
      echo 'Description: unpacked'
      echo; } >>"$root/var/lib/dpkg/status"
    dpkg-deb --fsys-tarfile "$deb" | tar -t | sed -n "s|^\./|$root/|p" >"$info/$id.list"
    dpkg-deb --ctrl-tarfile "$deb" | tar -x -O ./symbols >"$info/$id.symbols" 2>/dev/null || rm "$info/$id.symbols"
    dpkg-deb --ctrl-tarfile "$deb" | tar -x -O ./shlibs >"$info/$id.shlibs" 2>/dev/null || rm "$info/$id.shlibs"
  done
}

# What mmdebstrap runs when it has unpacked everything.
if [ "${3-}" = unpacked ]; then
  cd "$folder/var/cache/apt/archives"
  APT_CONFIG=$MMDEBSTRAP_APT_CONFIG apt-get download -q "${ALONE[@]}"
  for package in "${ALONE[@]}"; do dpkg-deb -x "$package"_*.deb "$folder"; done
  database "$folder"
  # What base-files would have done, since Debian 13 has all libraries in /usr/lib; and update-alternatives.
  [ -e "$folder/lib" ] || ln -s usr/lib "$folder/lib"
  ln -s lapack/liblapack.so.3 blas/libblas.so.3 "$folder/usr/lib/$triplet/"
  # Links are followed from here, not from within.
  find "$folder/usr/lib/$triplet" -type l -lname '/*' | while read -r link; do
    ln -sfnr "$folder$(readlink "$link")" "$link"
  done
  exit
fi

mkdir -p "$(dirname "$folder")"
folder=$(realpath "$folder")
stamp=$(printf '%s\n' "${sources[@]}" "${PACKAGES[@]}" | cat "${BASH_SOURCE[0]}" - | sha256sum)
[ "$(cat "$folder/stamp" 2>/dev/null)" != "$stamp" ] || exit 0
rm -rf "$folder"
packages=$(IFS=, && echo "${PACKAGES[*]}")
# shellcheck disable=SC2016 # the hook's own $1
mmdebstrap --quiet --variant=extract --architectures="$architecture" --include="$packages" \
  --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/man/*' \
  --dpkgopt='path-exclude=/usr/share/locale/*' \
  --extract-hook="$(printf '%q ' "$(realpath "${BASH_SOURCE[0]}")" "$architecture")"'"$1" unpacked' \
  "$(own_release)" "$folder" "${sources[@]}"
echo "$stamp" >"$folder/stamp"
echo "sysroot.sh: $folder: $(du -sm "$folder" | cut -f1) MB"

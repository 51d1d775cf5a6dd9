#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the Debian packages for ARCHITECTURE (this machine's, arm64, armhf) with Debian's own flags, in a clean
# FOLDER, where they are then. The same commit gives the same bytes, wherever that folder is.
# Usage: toolchain/package.sh ARCHITECTURE FOLDER
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
architecture=$1
folder=$(realpath -m "$2")
umask 022

SOURCE_DATE_EPOCH=$(git log -1 --format=%ct 2>/dev/null || stat -c %Y CHANGELOG.md)
export SOURCE_DATE_EPOCH DEB_HOST_ARCH=$architecture DEB_BUILD_MAINT_OPTIONS=hardening=+all
case $architecture in
  "$(dpkg --print-architecture)") preset=package ;;
  arm64) preset=aarch64 ;;
  armhf) preset=armhf ;;
  *) echo "package.sh: this machine's architecture, arm64 or armhf, not $architecture" >&2 && exit 2 ;;
esac
if [ "$preset" != package ]; then
  toolchain/sysroot.sh "$architecture" "build/sysroot-$architecture"
  export DPKG_ADMINDIR=$PWD/build/sysroot-$architecture/var/lib/dpkg
fi

rm -rf "$folder"
mkdir -p "$folder"
# Debug information is stripped from the packages, so none is made.
flags="-Wno-psabi $(dpkg-buildflags --get CXXFLAGS) $(dpkg-buildflags --get CPPFLAGS) -g0 -DNDEBUG"
cmake --preset "$preset" -B "$folder" -DORBBUF_BUILD_TESTS=OFF \
  -DCMAKE_CXX_FLAGS="$flags -ffile-prefix-map=$folder=build" \
  -DCMAKE_EXE_LINKER_FLAGS="$(dpkg-buildflags --get LDFLAGS) -Wl,--as-needed" >"$folder/configure.log" 2>&1 ||
  { cat "$folder/configure.log" >&2 && exit 1; }
cmake --build "$folder"
(cd "$folder" && cpack >cpack.log 2>&1) || { cat "$folder/cpack.log" >&2 && exit 1; }

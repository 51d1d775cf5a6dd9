#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Configures FOLDER to be built for ARCHITECTURE (this machine's, arm64 or armhf) as the Debian packages are:
# Debian's flags, hardened; for another architecture with its sysroot, which is made.
# Usage: toolchain/configure.sh ARCHITECTURE FOLDER [CMAKE_OPTION...]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
architecture=$1
folder=$2
shift 2
case $architecture in
  "$(dpkg --print-architecture)") preset=package ;;
  arm64) preset=aarch64 ;;
  armhf) preset=armhf ;;
  *) echo "configure.sh: this machine's architecture, arm64 or armhf, not $architecture" >&2 && exit 2 ;;
esac
[ "$preset" = package ] || toolchain/sysroot.sh "$architecture" "build/sysroot-$architecture"

export DEB_HOST_ARCH=$architecture DEB_BUILD_MAINT_OPTIONS="hardening=+all future=+lfs"
# Debug information is stripped from the packages, so none is made. What GCC 7 changed in ARM's ABI is no matter.
flags="$(dpkg-buildflags --get CXXFLAGS) $(dpkg-buildflags --get CPPFLAGS) -g0 -DNDEBUG -Wno-psabi"
mkdir -p "$folder"
cmake --preset "$preset" -B "$folder" -DCMAKE_CXX_FLAGS="$flags" \
  -DCMAKE_EXE_LINKER_FLAGS="$(dpkg-buildflags --get LDFLAGS) -Wl,--as-needed" "$@" >"$folder/configure.log" 2>&1 ||
  { cat "$folder/configure.log" >&2 && exit 1; }

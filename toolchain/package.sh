#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the Debian packages for ARCHITECTURE (this machine's, arm64 or armhf) in FOLDER, which is made
# again, and leaves them there. The same commit gives the same bytes, wherever that folder is.
# Usage: toolchain/package.sh ARCHITECTURE FOLDER
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
architecture=$1
folder=$2
umask 022
export CCACHE_DISABLE=1 # what a cache holds may have been compiled in another folder
rm -rf "$folder"
toolchain/configure.sh "$architecture" "$folder" -DORBBUF_BUILD_TESTS=OFF
cmake --build "$folder"

SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || stat -c %Y CHANGELOG.md)}
export SOURCE_DATE_EPOCH DEB_HOST_ARCH=$architecture
# Which package a library is of, dpkg-shlibdeps asks the sysroot's database.
[ "$architecture" = "$(dpkg --print-architecture)" ] ||
  export DPKG_ADMINDIR=$PWD/build/sysroot-$architecture/var/lib/dpkg
(cd "$folder" && cpack >cpack.log 2>&1) || { cat "$folder/cpack.log" >&2 && exit 1; }

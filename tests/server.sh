#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Tests the build for a server alone (./dev build server): it takes neither OpenCV nor libcamera, and serves.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
./dev build server
server=build/server/server/orbbuf-server
fail() { echo "server: $1" >&2 && exit 1; }

[ ! -e build/server/daemon ] || fail 'the daemon is built, too'
! readelf -d "$server" | grep -E 'NEEDED.*(opencv|camera)' || fail 'orbbuf-server is linked to a library of the daemon'
"$server" --check-config --set listen.insecure=true || fail 'the configuration is refused'
echo 'server: passed'

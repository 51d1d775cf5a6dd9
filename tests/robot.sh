#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Tests the build for a robot alone (./dev build robot): it captures and encodes, and refuses the policy orbbuf.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
./dev build robot
orbbufd=build/robot/daemon/orbbufd
fail() { echo "robot: $1" >&2 && exit 1; }

! readelf -d "$orbbufd" | grep 'NEEDED.*features2d' || fail 'orbbufd is linked to features2d'
"$orbbufd" --probe --set source.realtime=false --set source.frames=9 | grep -q '^JPEG: .* kB a frame' ||
  fail 'nothing captured'
! refusal=$("$orbbufd" --set buffer.policy=orbbuf 2>&1) || fail 'the policy orbbuf is not refused'
[[ $refusal == *"orbbufd was built without OpenCV's features2d"* ]] || fail "unexpected: $refusal"
echo 'robot: passed'

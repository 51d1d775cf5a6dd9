#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The test suite for 64- or 32-bit ARM, built as the packages are and run by qemu: unit tests and, with
# the real programs, end to end; with `quick` some of the latter only; with `compile` none: orbbufd is compiled, without
# the policy orbbuf, as ./dev build robot does.
# Usage: tests/arm_suite.sh arm64|armhf [quick|compile]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
build=build/$1
targets=(all)
choice=()
if [ "${2-}" = quick ]; then
  targets=(orbbufd orbbuf-server orbbuf-follow e2e_test)
  choice=(-R '^(Delivery|Pipe[.]|Programs|Stereo[.])')
fi

# Left out, as regular expressions.
LEFT_OUT=(
  '^V4l2Stream[.]WhatIsNoCameraIsRefused$'               # qemu-user knows none of V4L2's ioctls
  'OutageTest' 'FollowTest'                              # nor TCP_INFO, which is how a stall is seen
  'kitti0' '^Stereo[.]ARealSequenceArrives'              # PNG files, which the packaged program does not read
  '^OrbExtractor[.](UnrelatedFrames|NeighboursOfReal)'   # the same
)

if [ "${2-}" = compile ]; then
  toolchain/configure.sh "$1" "$build-robot" -DORBBUF_SERVER=OFF -DORBBUF_ORB=OFF
  cmake --build "$build-robot" --target orbbufd
  exit 0
fi
toolchain/configure.sh "$1" "$build"
cmake --build "$build" --target "${targets[@]}"
left_out=$(IFS='|' && echo "${LEFT_OUT[*]}")
ctest --test-dir "$build" --output-on-failure --no-tests=error -j "$(nproc)" --timeout 600 \
  -E "$left_out" "${choice[@]}"

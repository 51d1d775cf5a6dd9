#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The test suite for 64- or 32-bit ARM, cross-built with a sysroot and run by qemu: unit tests and, with the
# real programs, end to end. With `quick` only the buffer's, the capture's and the end-to-end ones.
# Usage: tests/arm_suite.sh aarch64|armhf [quick]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
preset=$1
targets=(all)
choice=()
case $preset in aarch64) sysroot=arm64 ;; *) sysroot=$preset ;; esac
if [ "${2-}" = quick ]; then
  targets=(orbbufd orbbuf-server orbbuf-pipe-reader buffer_test e2e_test)
  choice=(-R '^(Delivery|Nearest|Pipe|Programs|Similarity|Stereo)')
fi

# Left out, as regular expressions, because of qemu-user and not because of ARM.
LEFT_OUT=(
)

toolchain/sysroot.sh "$sysroot" "build/sysroot-$sysroot"
cmake --preset "$preset" >"build/$preset.log" 2>&1 || { cat "build/$preset.log" >&2 && exit 1; }
cmake --build "build/$preset" --target "${targets[@]}"
left_out=$(IFS='|' && echo "${LEFT_OUT[*]}")
ctest --test-dir "build/$preset" --output-on-failure --no-tests=error -j "$(nproc)" --timeout 600 \
  -E "$left_out" "${choice[@]}"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The tests of the vector code on ARM, which the development machine is not: compiled for 64 and 32
# bits and run by qemu on processors with NEON and without. Only the sources that have such code and
# their tests, so that no library for ARM is needed but GoogleTest, which is compiled from Debian's
# sources. Usage: tests/arm.sh
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
GTEST=/usr/src/googletest/googletest
SOURCES=("$root"/daemon/buffer/{nearest*,similarity}.cpp
  "$root"/tests/daemon/buffer/{nearest,similarity}_test.cpp)

# compile ARCHITECTURE COMPILER: to build/arm-ARCHITECTURE/buffer_test. Silenced: what GCC 7 changed
# in the 32-bit ABI, and the linker about GoogleTest's getaddrinfo.
compile() {
  local folder=$root/build/arm-$1 compiler=$2
  local flags=(-std=c++20 -O2 -isystem "$GTEST/include")
  echo "=== compiling for $1"
  mkdir -p "$folder/gtest"
  if [ ! -e "$folder/gtest/done" ]; then
    cd "$folder/gtest"
    "$compiler" "${flags[@]}" -I"$GTEST" -c "$GTEST"/src/gtest{-all.cc,_main.cc}
    touch 'done'
  fi
  cd "$folder"
  rm -f ./*.o
  printf '%s\n' "${SOURCES[@]}" | xargs -P "$(nproc)" -n 1 "$compiler" "${flags[@]}" -I"$root" \
    -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Werror -Wno-psabi -c
  "$compiler" -static -Wl,--no-warnings ./*.o gtest/*.o -o buffer_test
}

# run ARCHITECTURE EMULATOR CPU KERNEL: fails too if another kernel is the fastest on that CPU.
run() {
  echo "=== $1 on $3: $4"
  ORBBUF_EXPECT_KERNEL=$4 "$2" -cpu "$3" "$root/build/arm-$1/buffer_test" --gtest_brief=1
}

compile aarch64 aarch64-linux-gnu-g++
compile armhf arm-linux-gnueabihf-g++
run aarch64 qemu-aarch64-static cortex-a72 neon
run armhf qemu-arm-static cortex-a7 neon
run armhf qemu-arm-static cortex-a7,neon=off portable
echo 'arm: passed'

# SPDX-License-Identifier: Apache-2.0
# 64-bit ARM, with the sysroot that toolchain/sysroot.sh arm64 build/sysroot-arm64 makes.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_LIBRARY_ARCHITECTURE aarch64-linux-gnu)
set(CMAKE_SYSROOT ${CMAKE_CURRENT_LIST_DIR}/../build/sysroot-arm64)
set(CMAKE_CROSSCOMPILING_EMULATOR qemu-aarch64-static -cpu cortex-a53 -L ${CMAKE_SYSROOT})
include(${CMAKE_CURRENT_LIST_DIR}/sysroot.cmake)

# SPDX-License-Identifier: Apache-2.0
# 32-bit ARM, Debian's armhf, with the sysroot that toolchain/sysroot.sh armhf build/sysroot-armhf makes.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(CMAKE_LIBRARY_ARCHITECTURE arm-linux-gnueabihf)
set(CMAKE_SYSROOT ${CMAKE_CURRENT_LIST_DIR}/../build/sysroot-armhf)
set(CMAKE_CROSSCOMPILING_EMULATOR qemu-arm-static -cpu cortex-a7 -L ${CMAKE_SYSROOT})
include(${CMAKE_CURRENT_LIST_DIR}/sysroot.cmake)

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the example that the package orbbuf-dev installs against what else it installs, once by CMake's
# find_package and once by pkg-config, as C and as C++, and has each read an image. Usage: dev_package.sh BUILD
set -euo pipefail
build=$(cd "$1" && pwd)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cmake --install "$build" --component orbbuf-dev --prefix "$folder/usr" >/dev/null
source=$folder/usr/share/doc/orbbuf-dev/examples/follow.c

mkdir "$folder/program"
cp "$source" "$folder/program/"
cat >"$folder/program/CMakeLists.txt" <<'CMAKE'
cmake_minimum_required(VERSION 3.25)
project(program LANGUAGES C)
find_package(orbbuf 0.1 REQUIRED)
add_executable(by-cmake follow.c)
target_link_libraries(by-cmake PRIVATE orbbuf::pipe)
CMAKE
cmake -G Ninja -S "$folder/program" -B "$folder" -DCMAKE_PREFIX_PATH="$folder/usr" >/dev/null
cmake --build "$folder" >/dev/null

# Not through the .pc file's own prefix, which is where the package will be.
flags=$(PKG_CONFIG_PATH=$folder/usr/share/pkgconfig pkg-config --define-variable=prefix="$folder/usr" --cflags orbbuf)
read -ra flags <<<"$flags"
cc -std=c99 -Wall -Wextra -Wpedantic -Werror "${flags[@]}" "$source" -o "$folder/by-pkg-config"
c++ -x c++ -std=c++17 -Wall -Wextra -Wpedantic -Werror "${flags[@]}" "$source" -o "$folder/by-c++"

for program in by-cmake by-pkg-config by-c++; do
  said=$(printf 'P5\n# seq=3\n# t=1.250000000\n# session=s\n2 1\n255\nab' | "$folder/$program")
  [ "$said" = 's 3 1.250000 camera 0: 2 bytes' ] ||
    { echo "$program: $said" >&2 && exit 1; }
done

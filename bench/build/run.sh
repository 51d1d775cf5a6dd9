#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Measures builds from nothing, without ccache: CPU seconds, user and system, of all compilers and linkers.
# usage: bench/build/run.sh WORK [programs|test]... [--tree FOLDER]
# programs: orbbufd and orbbuf-server, as a user builds them; test: all that ./dev test builds. Default: both.
# --tree: the source tree to build, for a comparison with another commit; default: this one.
set -euo pipefail
work=$(realpath -m "$1")
shift
parts=() tree=$(realpath "$(dirname "${BASH_SOURCE[0]}")/../..")
while [ $# -gt 0 ]; do
  case $1 in
    programs | test) parts+=("$1") ;;
    --tree) tree=$(realpath "$2") && shift ;;
    *) echo "bench build: unknown argument $1" >&2 && exit 2 ;;
  esac
  shift
done
[ ${#parts[@]} -gt 0 ] || parts=(programs test)
unset CMAKE_CXX_COMPILER_LAUNCHER CMAKE_C_COMPILER_LAUNCHER

# measure PART PRESET [OPTION...] [-- TARGET...]
measure() {
  local part=$1 preset=$2 folder=$work/$1 options=() used
  shift 2
  while [ $# -gt 0 ] && [ "$1" != -- ]; do options+=("$1") && shift; done
  rm -rf "$folder"
  mkdir -p "$folder"
  cmake -S "$tree" --preset "$preset" -B "$folder" "${options[@]}" >"$folder.log" 2>&1 ||
    { tail -n 20 "$folder.log" >&2 && exit 1; }
  # TIMEFORMAT is for bash's own `time`, which counts all children that have been waited for.
  used=$(TIMEFORMAT='%U %S' && { time cmake --build "$folder" ${2+--target "${@:2}"} >>"$folder.log" 2>&1; } 2>&1) ||
    { tail -n 50 "$folder.log" >&2 && exit 1; }
  awk -v part="$part" '{ printf "RESULT build.%s_cpu_s %.0f\n", part, $1 + $2 }' <<<"$used"
}

cd "$tree" # for its presets
for part in "${parts[@]}"; do
  case $part in
    programs)
      measure programs release -DORBBUF_BUILD_TESTS=OFF -DORBBUF_BUILD_BENCH=OFF -- orbbufd orbbuf-server
      ;;
    test) measure test dev ;;
  esac
done

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The same seed gives the same trace, byte for byte; also where a system call sets the thread pointer (fibers.cpp), and
# with the programs of another build, such as that for another processor, which words of a command then run.
# Usage: testing/simulation/same_trace.sh ORBBUF_SIMULATE [SEED [BUILD_FOLDER [EMULATOR_WORD...]]]
set -euo pipefail
simulate=$1 seed=${2-3} build=${3-}
shift $(($# < 3 ? $# : 3))
other=()
for word; do other+=(--emulator "$word"); done
[ -z "$build" ] || other+=(--build "$build")
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-trace.XXXXXX")
trap 'rm -rf "$work"' EXIT
outcome() { "$simulate" --seed "$seed" "$@" | grep '^sessions '; }
outcome --trace "$work/1" > "$work/outcome"
ORBBUF_NO_FSGSBASE=1 outcome --trace "$work/2" "${other[@]}" > /dev/null
[ -s "$work/1" ]
cmp "$work/1" "$work/2"
outcome | cmp - "$work/outcome" # without a trace, too

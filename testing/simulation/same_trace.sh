#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The same seed gives the same trace, byte for byte.
# Usage: testing/simulation/same_trace.sh ORBBUF_SIMULATE [SEED]
set -euo pipefail
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-trace.XXXXXX")
trap 'rm -rf "$work"' EXIT
for run in 1 2; do
  "$1" --seed "${2-3}" --trace "$work/$run" > /dev/null
done
[ -s "$work/1" ]
cmp "$work/1" "$work/2"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What SLAM feels of JPEG quality: a corridor of orbbuf-world that the robot drives through twice, and the
# recorded sequences. Prints a table and RESULT lines for each.
# Usage: evaluation/quality/run.sh BUILD_FOLDER SEQUENCES_FOLDER
set -euo pipefail
build=$1/evaluation sequences=$2
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-quality.XXXXXX")
trap 'rm -rf "$work"' EXIT
"$build/orbbuf-world" "$work/corridor" --frames 750
"$build/orbbuf-world" "$work/second" --frames 750 --aside 0.3
"$build/orbbuf-quality" "$work/corridor" --second "$work/second"
# So far apart that half of the features and more match no longer.
for plan in kitti05_stereo:8 kitti06_mono:5 picar_indoor:24 tsukuba_synth:16; do
  if [ -d "$sequences/${plan%:*}" ]; then
    "$build/orbbuf-quality" "$sequences/${plan%:*}" --apart "${plan#*:}"
  else
    echo "bench quality: skipped: no $sequences/${plan%:*}"
  fi
done

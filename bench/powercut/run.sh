#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Power cuts under load, with an audit; then what syncs cost. Options as `orbbuf-powercut --help` has them.
# Usage: bench/powercut/run.sh BUILD_FOLDER [--cuts N] [--seed N] [--sync ack] [--mcap] [--file-system xfs]
# Needs root, loop devices, and ext4 or xfs. Exit status 77: this machine has not got them.
set -euo pipefail
build=$(cd "$1" && pwd)
shift
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-powercut.XXXXXX")
trap 'rm -rf "$work"' EXIT
"$build/bench/orbbuf-powercut" --server "$build/server/orbbuf-server" --work "$work" "$@"
for robots in 1 64; do
  "$build/bench/orbbuf-sync-cost" "$work" $robots 5
done

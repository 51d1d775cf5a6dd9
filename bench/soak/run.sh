#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Memory over a long time, and the account of every frame; options as `orbbuf-soak --help` has them.
# Usage: bench/soak/run.sh BUILD_FOLDER [--long] [--minutes N] [--seed N]
# Writes about 1 MB a second into $TMPDIR, and removes it unless something is wrong.
set -euo pipefail
build=$(cd "$1" && pwd)
shift
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-soak.XXXXXX")
if "$build/bench/orbbuf-soak" --robot "$build/daemon/orbbufd" \
  --server "$build/server/orbbuf-server" --work "$work" "$@"; then
  rm -rf "$work"
else
  status=$?
  [ $status -eq 77 ] || echo "soak: all that was written is in $work" >&2
  exit $status
fi

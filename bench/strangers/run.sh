#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Strangers at a server's ports; options as `orbbuf-strangers --help` has them.
# Usage: bench/strangers/run.sh BUILD_FOLDER [--quick] [--seconds N]
set -euo pipefail
build=$(cd "$1" && pwd)
shift
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-strangers.XXXXXX")
ulimit -Sn "$(ulimit -Hn)" # a socket each
if "$build/bench/orbbuf-strangers" --robot "$build/daemon/orbbufd" --server "$build/server/orbbuf-server" \
  --work "$work" "$@"; then
  rm -rf "$work"
else
  status=$?
  echo "strangers: all that was written is in $work" >&2
  exit $status
fi

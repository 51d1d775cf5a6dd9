#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Chaos on the link, and the account of every frame; options as `orbbuf-chaos --help` has them.
# Usage: bench/chaos/run.sh BUILD_FOLDER [--seed N] [--events N] [--long] [--two-links] [--tls] ...
set -euo pipefail
build=$(cd "$1" && pwd)
shift
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-chaos.XXXXXX")
if "$build/bench/orbbuf-chaos" --robot "$build/daemon/orbbufd" \
  --server "$build/server/orbbuf-server" --work "$work" --traces ../shared/data/traces "$@"; then
  rm -rf "$work"
else
  status=$?
  [ $status -eq 77 ] || echo "chaos: all that was written is in $work" >&2
  exit $status
fi

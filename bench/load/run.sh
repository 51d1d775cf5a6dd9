#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Many robots into one server, on loopback; options as `orbbuf-load --help` has them.
# Usage: bench/load/run.sh BUILD_FOLDER [--robots N] [--fps N] [--bytes N] [--seconds N] [--quick] ...
# Writes robots x fps x bytes x seconds into $TMPDIR, 3.8 GB by default, and removes it.
set -euo pipefail
build=$(cd "$1" && pwd)
shift
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-load.XXXXXX")
trap 'rm -rf "$work"' EXIT
ulimit -Sn "$(ulimit -Hn)" # two sockets a robot
"$build/bench/orbbuf-load" --server "$build/server/orbbuf-server" --work "$work" "$@"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Many robots into one server, on loopback; options as `orbbuf-load --help` has them.
# Usage: bench/load/run.sh BUILD_FOLDER [--robots N] [--fps N] [--bytes N] [--seconds N] [--quick]
#   [--idle-robots N] [--idle-seconds N] [--seed N]
# Writes robots x fps x bytes x seconds into $TMPDIR, 3.8 GB by default, and removes it.
set -euo pipefail
build=$(cd "$1" && pwd)
shift
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-load.XXXXXX")
trap 'rm -rf "$work"' EXIT

# How many discards the disk of $work has done: each may hold up all else for seconds.
discards() {
  local device
  device=$(stat -c '%Hd %Ld' "$work")
  awk -v d="$device" '$1 " " $2 == d { print $15 + 0 }' /proc/diskstats
}

# What others have deleted is discarded by a file system so mounted when its journal is written, 5 s
# later or more: waits until none has come for that long, at most a minute.
await_quiet_disk() {
  local before='' now tries=0
  sync -f "$work"
  until now=$(discards) && [ "$now" = "$before" ] || [ $((tries++)) -ge 10 ]; do
    before=$now
    sleep 6
  done
}

await_quiet_disk
discarded=$(discards)
ulimit -Sn "$(ulimit -Hn)" # two sockets a robot
"$build/bench/orbbuf-load" --server "$build/server/orbbuf-server" --work "$work" "$@"
[ "$(discards)" = "$discarded" ] ||
  echo "load: the disk discarded what was deleted meanwhile: run it again" >&2

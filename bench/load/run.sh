#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Many robots into one server, on loopback; options as `orbbuf-load --help` has them.
# Usage: bench/load/run.sh BUILD_FOLDER [--robots N] [--fps N] [--bytes N] [--seconds N] [--quick]
#   [--idle-robots N] [--idle-seconds N] [--seed N]
#   [--sync ack] [--only stream|idle|resume|pipes|viewers]
# Writes robots x fps x bytes x seconds into $TMPDIR, 3.8 GB by default, and removes it.
set -euo pipefail
build=$(cd "$1" && pwd)
shift
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-load.XXXXXX")
trap 'rm -rf "$work"' EXIT

# True if the file system gives out new files quickly, in folders all over it.
creates_quickly() {
  local folder="$work/probe$1" begin=$EPOCHREALTIME
  mkdir -p "$folder"/{1..64} && touch "$folder"/{1..64}/{1..20}
  awk -v a="$begin" -v b="$EPOCHREALTIME" 'BEGIN { exit b - a > 0.2 }'
}

# ext4 does not give out again what was deleted within the last minute, or five if that is not on
# the disk yet, and searches on from one such inode to the next: after the removal of what an
# earlier run has written, the server would spend its time there (perf: recently_deleted).
sync -f "$work"
for ((try = 0; try < 40; ++try)); do
  ! creates_quickly $try || break
  [ $try -gt 0 ] || echo 'load: waits while the file system remembers what was deleted' >&2
  sleep 10
done
ulimit -Sn "$(ulimit -Hn)" # two sockets a robot
"$build/bench/orbbuf-load" --server "$build/server/orbbuf-server" --work "$work" "$@"

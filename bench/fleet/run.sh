#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A fleet under chaos, and the account of every frame; options as `orbbuf-fleet --help` has them.
# Usage: bench/fleet/run.sh BUILD_FOLDER [--minutes N] [--seed N] [--robots N] [--calm] ...
# As root it runs in a network namespace of its own, where servers are cut off from etcd and from robots, too.
set -euo pipefail
build=$(cd "$1" && pwd)
shift
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-fleet.XXXXXX")
chmod 755 "$work"
command=("$build/bench/orbbuf-fleet" --server "$build/server/orbbuf-server" --work "$work" "$@")
if [ "$(id -u)" -eq 0 ] && command -v nft >/dev/null; then
  # The servers run as other users, who may not look into the checkout.
  install -m 755 "$build/server/orbbuf-server" "$work/orbbuf-server"
  command=(unshare --net sh -c 'ip link set lo up && exec "$@"' sh "$build/bench/orbbuf-fleet" --server "$work/orbbuf-server"
    --work "$work" --alone "$@")
else
  echo 'fleet: not root, or no nft: no partitions' >&2
fi
if "${command[@]}"; then
  rm -rf "$work"
else
  status=$?
  echo "fleet: all that was written is in $work" >&2
  exit $status
fi

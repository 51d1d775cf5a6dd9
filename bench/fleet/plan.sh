#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What a fleet needs on paper (docs/fleet.md). Usage: bench/fleet/plan.sh [ROBOTS ...]
# From the environment: fps, bytes (of a frame), disk and net (usable bytes a second of a server), days (kept).
set -euo pipefail
fps=${fps:-25} bytes=${bytes:-40000} disk=${disk:-500e6} net=${net:-600e6} days=${days:-7}
echo '| robots | servers | frames/s | GB/s | etcd requests/s | positions/s | TB a day | PB in '"$days"' days |'
echo '|---|---|---|---|---|---|---|---|'
for robots in "${@:-10 1000 100000}"; do
  for count in $robots; do
    awk -v n="$count" -v fps="$fps" -v bytes="$bytes" -v disk="$disk" -v net="$net" -v days="$days" 'BEGIN {
      rate = n * fps * bytes
      limit = disk < net ? disk : net
      servers = int((rate + limit - 1) / limit)
      if (servers < 2) servers = 2  # one more than the load needs, at least
      else servers += 1
      requests = 5 * servers * (1 + int(n / servers / 100 - 1e-9))
      printf "| %d | %d | %d | %.3g | %d | %d | %.3g | %.3g |\n", n, servers, n * fps, rate / 1e9, requests, 5 * n,
             rate * 86400 / 1e12, rate * 86400 * days / 1e15
    }'
  done
done

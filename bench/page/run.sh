#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What one open page costs the server, in processor time, while so many robots stream: what a browser asks for,
# the figures and each robot's image once a second, in every other stretch of 5 s.
# Usage: bench/page/run.sh BUILD_FOLDER [--robots N]
set -euo pipefail
build=$(cd "$1" && pwd)
robots=64
[ "${2-}" != --robots ] || robots=$3
stretches=8
port=17999
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-page.XXXXXX")
trap 'kill "$load" 2>/dev/null || true; wait || true; rm -rf "$work"' EXIT

# orbbuf-load's server, with a page.
printf '#!/bin/sh\n[ -e %s/pid ] || echo $$ >%s/pid\nexec %s "$@" --set http.address=127.0.0.1:%s\n' \
  "$work" "$work" "$build/server/orbbuf-server" "$port" >"$work/server"
chmod +x "$work/server"
mkdir "$work/data"
"$build/bench/orbbuf-load" --server "$work/server" --work "$work/data" --robots "$robots" --fps 5 \
  --seconds $((stretches * 5 + 8)) --idle-robots 1 --idle-seconds 0.1 >"$work/load.log" &
load=$!

# cpu_ns: of all the server's threads, so far.
cpu_ns() { cat /proc/"$pid"/task/*/schedstat | awk '{ sum += $1 } END { printf "%d\n", sum }'; }

page=http://127.0.0.1:$port
for ((try = 0; try < 100; ++try)); do
  known=$(curl -s "$page/api/robots" | grep -o '"image"' | wc -l) || true
  [ "$known" -lt "$robots" ] || break
  sleep 0.1
done
pid=$(cat "$work/pid")
curl -s "$page/api/robots" | grep -oP '"robot":"\K[^"]+' | sed "s|.*|url = $page/robots/&/image|" >"$work/urls"
[ "$(wc -l <"$work/urls")" -eq "$robots" ] || { echo "page: not all robots stream" >&2 && exit 1; }
echo "url = $page/api/robots" >>"$work/urls"
sed -i 's|$|\noutput = /dev/null|' "$work/urls"
printf 'write-out = "%%{http_code} %%{size_download}\\n"\n' >>"$work/urls"

used=(0 0) # without a page, with a page
touch "$work/answers"
for ((i = 0; i < stretches; ++i)); do
  before=$(cpu_ns)
  end=$((SECONDS + 5))
  while [ $SECONDS -lt $end ]; do
    [ $((i % 2)) -eq 0 ] || curl -sS -K "$work/urls" >>"$work/answers" || true # told below
    sleep 1
  done
  used[i % 2]=$((${used[i % 2]} + $(cpu_ns) - before))
done
awk -v s="$((stretches * 5 / 2))" -v n="$robots" '{ bytes += $2 } $1 != 200 { ++refused } END {
  printf "  the page: %d answers (at least %d were to come), %.0f kB/s, %d refused\n",
    NR, n * s / 2, bytes / s / 1000, refused
  exit refused > 0 || NR < n * s / 2 }' "$work/answers"
wait "$load" || { cat "$work/load.log" && exit 1; }
grep -h 'RESULT load.\(delivered_share\|p99_ms\)' "$work/load.log" | sed 's/RESULT/  with the page:/'
awk -v off="${used[0]}" -v on="${used[1]}" -v s="$((stretches * 5 / 2))" -v n="$robots" 'BEGIN {
  printf "  server: %.1f %% of a core without a page, %.1f %% with a page\n", off / s / 1e7, on / s / 1e7
  printf "RESULT page.cpu_percent_%d %.2f\n", n, (on - off) / s / 1e7 }'

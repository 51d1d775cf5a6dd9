# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# To be sourced: the contenders over real TCP, each with network namespaces of its own, several at a
# time. Wants `build`, `here`, `out` and `say`.

# contend WORLD OUTAGE_S EVERY_S FIRST_S CONTENDER...: runs all at once, a folder each below
# $out/real; FIRST_S is in the folder's name.
contend() {
  local world=$1 outage=$2 every=$3 first=$4 contender status running=()
  shift 4
  for contender in "$@"; do
    "$here/flow.sh" "$build" "$world" "$out/real/$contender@$first" "$contender" "$first" "$every" \
      "$outage" "$mbit" &
    running+=($!)
  done
  local seconds said=0 total
  total=$(awk '{ t = $2 } END { printf "%d", t + 8 }' "$world/times.txt")
  SECONDS=0
  while [ -n "$(jobs -r)" ]; do
    seconds=$SECONDS
    if [ -t 2 ]; then
      printf '\rreal link: %d contenders, %d of about %d s  ' $# "$seconds" "$total" >&2
    elif [ $((seconds - said)) -ge 5 ]; then
      said=$seconds
      say "real link: $# contenders, $seconds of about $total s"
    fi
    sleep 1
  done
  [ ! -t 2 ] || echo >&2
  for contender in "${running[@]}"; do
    status=0
    wait "$contender" || status=$?
    [ $status -eq 0 ] || [ $status -eq 77 ] || exit $status
  done
}

# The 95 % interval is orbbuf-trial's; here is what stands beside it.
peer_table() {
  echo '| | longest gap, frames | back after, s: median, worst | CPU a frame, ms | peak memory, MiB | delivered |'
  echo '|---|---|---|---|---|---|'
  local summary name
  for summary in "$out"/real/*/summary; do
    name=$(basename "$(dirname "$summary")")
    awk -v n="$name" '{ printf "| %s | %d | %.2f, %.2f | %.2f | %.0f | %d |\n", n, $1, $2, $3, $4, $5 / 1024, $6 }' "$summary"
  done
}

peer_results() {
  local summary name
  for summary in "$out"/real/*@"$1"/summary; do
    name=$(basename "$(dirname "$summary")")
    awk -v n="${name%@*}" '{ printf "RESULT paper.peer.%s.longest_gap %d\nRESULT paper.peer.%s.return_s %.3f\nRESULT paper.peer.%s.cpu_ms_per_frame %.3f\n", n, $1, n, $2, n, $4 }' "$summary"
  done
}

# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# To be sourced: the contenders over real TCP, each with network namespaces of its own, several at a
# time. Wants `build`, `here`, `out`, `mbit`, `seed`, `say` and PEERS, who need not be installed; `failed` gets
# who failed, GROUP/CONTENDER@RUN.
failed=()
# shellcheck source=evaluation/real/summary.sh
. "$here/real/summary.sh"

# contend GROUP RUN WORLD LINK QUEUE OUTAGE_S EVERY_S FIRST_S CONTENDER...: runs all at once, each to a
# folder $out/GROUP/CONTENDER@RUN; flow.sh says what the others are.
contend() {
  local group=$1 run=$2 world=$3 link=$4 queue=$5 outage=$6 every=$7 first=$8 contender status running=() peers
  shift 8
  for contender in "$@"; do
    "$here/real/flow.sh" "$build" "$world" "$out/$group/$contender@$run" "$contender" "$link" "$queue" "$mbit" \
      "$first" "$every" "$outage" "$seed" &
    running+=($!)
  done
  local seconds said=0 total
  total=$(awk 'NR == 1 { b = $2 } { t = $2 - b } END { printf "%d", t + 8 }' "$world/times.txt")
  SECONDS=0
  while [ -n "$(jobs -r)" ]; do
    seconds=$SECONDS
    if [ -t 2 ]; then
      printf '\r%s: %d contenders, %d of about %d s  ' "$group" $# "$seconds" "$total" >&2
    elif [ $((seconds - said)) -ge 5 ]; then
      said=$seconds
      say "$group: $# contenders, $seconds of about $total s"
    fi
    sleep 1
  done
  [ ! -t 2 ] || echo >&2
  for contender in "$@"; do
    status=0
    wait "${running[0]}" || status=$?
    running=("${running[@]:1}")
    peers=" ${PEERS[*]} "
    [ $status -eq 77 ] && [ "${peers#* "$contender" }" != "$peers" ] && continue
    [ $status -eq 0 ] || failed+=("$group/$contender@$run")
  done
}

# The contender jpegenc's camera gives gray images, and GStreamer encodes them. So that its receiver
# knows them they are encoded before, too, to WORLD/jpegenc, by the same elements, which stand there.
encode_for_jpegenc() { # WORLD
  gst-inspect-1.0 jpegenc >/dev/null 2>&1 || return 0 # flow.sh says so
  mkdir -p "$1/jpegenc/images"
  cp "$1/times.txt" "$1/jpegenc/"
  local size encode
  size=$(sed -n 2p "$1/camera.txt")
  encode=(rawvideoparse format=gray8 "width=${size% *}" "height=${size#* }" ! jpegenc quality=80)
  printf '%s\n' "${encode[@]}" >"$1/jpegenc/elements"
  "$build/evaluation/orbbuf-evaluation-peer" decode "$1" |
    gst-launch-1.0 -q fdsrc ! "${encode[@]}" ! multifilesink location="$1/jpegenc/images/%06d.jpg"
}

# sessions_of GROUP: orbbuf-trial's words for what of it came through.
sessions_of() {
  local folder
  sessions=()
  for folder in "$out/$1"/*; do
    [ ! -s "$folder/summary" ] || sessions+=(--session "$(basename "$folder")=$folder")
  done
}

# outages_of GROUP: lines RUN FIRST LAST (frames) of all of it.
outages_of() {
  local folder
  for folder in "$out/$1"/*; do
    [ -s "$folder/summary" ] || continue
    awk -v n="$(basename "$folder")" '{ print n, $3, $4 }' "$folder/outages"
  done
}

# peer_table GROUP: what stands beside orbbuf-trial's 95 % intervals.
peer_table() {
  echo '| | longest gap, frames | back after, s: median, worst | live again after, s: median, worst | CPU a frame, ms | peak memory, MiB | delivered |'
  echo '|---|---|---|---|---|---|---|'
  local summary name
  for summary in "$out/$1"/*/summary; do
    [ -e "$summary" ] || continue
    name=$(basename "$(dirname "$summary")")
    summary_row "$name" <"$summary"
  done
}

peer_results() {
  local summary name
  for summary in "$out"/real/*@"$1"/summary; do
    [ -e "$summary" ] || continue
    name=$(basename "$(dirname "$summary")")
    summary_results "${name%@*}" <"$summary"
  done
}

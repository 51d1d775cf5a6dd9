#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Where every frame is that the robots of tests/vm/ship.sh captured: from the server's folder, and from the
# robot's logs beside it. A session that ended in peace has each frame once, delivered or in drops.csv; of
# one that was killed, frames after the last that came died with it. Usage: tests/vm/record.sh RECORD
set -euo pipefail
cd "$1"
problems=0 sessions=0 delivered=0 dropped=0 died=0
problem() {
  echo "record: $session: $1"
  problems=$((problems + 1))
}

# A line for each session in the logs: name, frames captured, whether it ended in peace, frames dropped, acknowledged.
cat before.log after.log | awk '
  / session [0-9TZ-]+/ && /robot / { match($0, /session [^,]+/); name = substr($0, RSTART + 8, RLENGTH - 8); order[n++] = name }
  /captured [0-9]+/ && name != "" {
    gsub(/[=+]/, " ")
    for (i = 1; i < NF; ++i) if ($(i + 1) ~ /^[0-9]+$/) value[$i] = $(i + 1)
    captured[name] = value["captured"]
    lost[name] = value["skipped"] + value["failed"] + value["dropped"]
    acknowledged[name] = value["acknowledged"]
    if ($0 ~ /session ended/) ended[name] = 1
  }
  END { for (i = 0; i < n; ++i) { s = order[i]; print s, captured[s] + 0, ended[s] + 0, lost[s] + 0, acknowledged[s] + 0 } }' >sessions.txt

while read -r session captured ended lost acknowledged; do
  folder=turtlebot1/$session
  if [ ! -d "$folder" ]; then
    [ "$acknowledged" -eq 0 ] || problem "acknowledged $acknowledged frames and has no folder"
    continue
  fi
  sessions=$((sessions + 1))
  cut -d' ' -f1 "$folder/times.txt" >ids.txt
  { tail -n +2 "$folder/drops.csv" 2>/dev/null || true; } | cut -d, -f1 >drops.txt
  sort -n -c -u ids.txt || problem 'repeated or out of order in times.txt'
  [ -z "$(sort ids.txt drops.txt | uniq -d)" ] || problem 'a frame is there twice'
  while read -r id; do
    [ -s "$folder/images/$(printf %06d "$id").jpg" ] || problem "no image $id"
  done <ids.txt
  count=$(wc -l <ids.txt) named=$(wc -l <drops.txt) reach=$(($(tail -n 1 ids.txt) + 1))
  holes=$((reach - count - $(awk -v reach="$reach" '$1 < reach' drops.txt | wc -l)))
  [ "$count" -ge "$acknowledged" ] || problem "$count delivered, but $acknowledged acknowledged"
  if [ "$ended" = 1 ]; then
    [ $((count + named)) -eq "$captured" ] || problem "$count + $named frames, not $captured"
  elif [ "$holes" -gt $((lost > named ? lost - named : 0)) ]; then # those that it had named, but not to the server yet
    problem "$holes frames are missing"
  else
    died=$((died + holes + (captured > reach ? captured - reach : 0)))
  fi
  delivered=$((delivered + count)) dropped=$((dropped + named))
done <sessions.txt

if [ $problems -eq 0 ] && [ $sessions -gt 0 ]; then verdict=PASS; else verdict=FAIL; fi
echo "$verdict ship: the record is exact: $sessions sessions, $delivered frames delivered, $dropped named" \
  "as dropped, $died died with a robot that was killed, $problems problems"
[ $verdict = PASS ]

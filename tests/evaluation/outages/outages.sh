#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# orbbuf-outages: the figures of trajectories made by hand; lists of a world of 5 s, which are as they should be, and
# a folder of one. Usage: outages.sh FOLDER_OF_PROGRAMS
set -euo pipefail
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-outages.XXXXXX")
trap 'rm -rf "$work"' EXIT
said() { grep -qxF "$1" "$work/said" || { echo "not said: $1" && cat "$work/said" && return 1; } >&2; }

# A square, a corner a second, with the heights H and -H in turns; the pose at 3 s turned about z by an angle with this
# sine and cosine of its half.
trajectory() { # H SINE COSINE
  printf '0 1 0 %s 0 0 0 1\n1 0 1 -%s 0 0 0 1\n2 -1 0 %s 0 0 0 1\n3 0 -1 -%s 0 0 %s %s\n' "$1" "$1" "$1" "$1" "$2" "$3"
}

# Ten places. catch-up: 0.75 m off in each; uniform: a tenth too far off in four; drop-oldest: 10 degrees wrong, or, in
# one place, never started.
for place in 0 1 2 3 4 5 6 7 8 9; do
  lists=$work/lists/square/constant-1.5/1s-1s/$place
  runs=$work/runs/square/constant-1.5/1s-1s/$place
  mkdir -p "$lists" "$runs"
  for policy in catch-up uniform drop-oldest unbroken; do
    {
      printf '# orbbuf outage list 1\n# policy %s\n# lateness_s 1\n' $policy
      printf '# outage_begin_s 1.5\n# outage_length_s 0.5\nimage,number,capture_s,arrival_s,quality\n'
      for frame in 0 1 2 3; do echo "$frame.png,$frame,$frame,$frame.1,80"; done
    } >"$lists/$policy.csv"
  done
  trajectory 0 0 1 >"$lists/truth.txt"
  trajectory 0.26 0 1 >"$runs/unbroken.txt"
  trajectory 0.75 0 1 >"$runs/catch-up.txt"
  trajectory "$([ "$place" -lt 4 ] && echo 0.85 || echo 0.75)" 0 1 >"$runs/uniform.txt"
  [ "$place" = 9 ] || trajectory 0 0.0871557427 0.9961946981 >"$runs/drop-oldest.txt"
done
"$1/orbbuf-outages" judge "$work/lists" "$work/runs" --metric --ate-floor 0 >"$work/said"
said 'list,survived,tracked,relocalised,ate,rpe,rpe_deg,turn_deg,unbroken_ate,unbroken_turn_deg,poses'
said 'square/constant-1.5/1s-1s/0/catch-up,1,1,0,0.7500,1.5000,0.000,0.00,0.2600,0.00,4'
said 'square/constant-1.5/1s-1s/0/uniform,0,1,0,0.8500,1.7000,0.000,0.00,0.2600,0.00,4'
said 'square/constant-1.5/1s-1s/4/uniform,1,1,0,0.7500,1.5000,0.000,0.00,0.2600,0.00,4'
said 'square/constant-1.5/1s-1s/0/drop-oldest,0,1,0,0.0000,0.0000,5.774,10.00,0.2600,0.00,4'
said 'square/constant-1.5/1s-1s/9/drop-oldest,0,0,0,0.0000,0.0000,0.000,0.00,0.2600,0.00,0'
# Wilson: 10 / (10 + 1.96^2) and 1; (6 + 1.92 +- 1.96 sqrt(2.4 + 0.96)) / (10 + 3.84). McNemar: 2 / 2^4, 2 / 2^6.
said 'RESULT outages.square/constant-1.5/1s-1s.catch-up.survived 10/10 1.0000 0.7225 1.0000'
said 'RESULT outages.all.uniform.survived 6/10 0.6000 0.3127 0.8318'
said 'RESULT outages.all.drop-oldest.survived 0/10 0.0000 0.0000 0.2775'
said 'RESULT outages.all.catch-up.against_uniform 6 4 0 0 0.1250'
said 'RESULT outages.all.drop-oldest.against_uniform 0 0 6 4 0.0312'
# One camera's estimate has no scale: 0.75 / sqrt(1 + 0.75^2), and the unbroken run's 0.26 / sqrt(1 + 0.26^2).
"$1/orbbuf-outages" judge "$work/lists" "$work/runs" >"$work/said"
said 'square/constant-1.5/1s-1s/0/catch-up,1,1,0,0.6000,1.0866,0.000,0.00,0.2516,0.00,4'

"$1/orbbuf-world" "$work/world" --seed 3 --frames 130 >/dev/null
"$(dirname "$0")/../../../evaluation/outages/convert_link.py" model roaming "$work/roaming.json"
"$1/orbbuf-outages" make "$work/world" "$work/made" --traces "$work" --links constant:1.5 roaming.json:9 \
  --outages 2 --places 2 --lead 2 --tail 1 --truth "$work/world/truth.txt" --policies catch-up drop-oldest oracle unbroken 2>/dev/null
made=$work/made/world/constant-1.5/2s-1s/00
names=("$made"/*)
[ "${names[*]##*/}" = 'catch-up.csv drop-oldest.csv oracle.csv truth.txt unbroken.csv' ]
grep -qx "# sha256 $(cat "$work"/world/images/* | sha256sum | cut -d' ' -f1)" "$made/catch-up.csv"
# In capture order without repeats, nothing arrives while the link is down or before it is captured, and live in time:
# longest step in capture time, and how long after the return the stream was live.
steps() {
  awk -F, -v begin=2 -v end=4 '/^# live_again_s/ { split($0, words, " "); live = words[3] }
    /^[#i]/ { next }
    last != "" && $3 <= last || $4 < $3 || $4 > begin + 0.2 && $4 < end { bad = 1 }
    { if (last != "" && $3 - last > step) step = $3 - last; last = $3 }
    END { if (bad) exit 1; printf "%.3f %s\n", step, live }' "$1"
}
read -r step live < <(steps "$made/catch-up.csv")
awk -v step="$step" -v live="$live" 'BEGIN { exit !(step <= 0.17 && live <= 1.1) }'
read -r oracle _ < <(steps "$made/oracle.csv")
awk -v oracle="$oracle" -v step="$step" 'BEGIN { exit !(oracle <= step + 1e-6) }'
read -r oldest _ < <(steps "$made/drop-oldest.csv")
awk -v oldest="$oldest" 'BEGIN { exit !(oldest > 1) }'
[ "$(grep -c '^[^#i]' "$made/unbroken.csv")" -gt 100 ]
[ "$(grep -c '^[^#i]' "$work/made/world/roaming-9/2s-1s/00/catch-up.csv")" -gt 50 ]

"$1/orbbuf-outages" folder "$made/catch-up.csv" "$work/world" "$work/folder"
images=("$work"/folder/images/*)
[ "${#images[@]}" = "$(grep -c '^[^#i]' "$made/catch-up.csv")" ]
[ "$(wc -l <"$work/folder/times.txt")" = "$(wc -l <"$work/folder/arrivals.txt")" ]
[ "$(head -c 2 "${images[0]}" | od -An -tx1)" = ' ff d8' ]
rm "$(find "$work/world/images" -type f | head -n 1)"
"$1/orbbuf-outages" folder "$made/catch-up.csv" "$work/world" "$work/other" 2>"$work/why" && exit 1
grep -q 'another checksum' "$work/why"

# The samples of a sensor on that path: 5.16 s at 200 Hz; at rest on average, it feels 9.81 m/s^2.
"$1/orbbuf-imu" "$work/world/truth.txt" "$work/imu.csv" --grade none
grep -v '^#' "$work/imu.csv" | awk -F, '
  NR == 1 { first = $1 }
  { last = $1; sum += sqrt($5 * $5 + $6 * $6 + $7 * $7) }
  END { exit !(NR >= 1032 && NR <= 1035 && last - first > 5.15e9 && sum / NR > 9.5 && sum / NR < 10.5) }'

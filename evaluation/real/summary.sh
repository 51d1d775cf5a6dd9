# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# To be sourced: what is said of one contender's arrivals. ARRIVALS: a file with a line FRAME TIME for each,
# by frame.

# longest_gap ARRIVALS FRAMES: most of so many frames that are missing in a row, up to the last of all.
longest_gap() {
  awk -v n="$2" '{ if (NR > 1 && $1 - last - 1 > g) g = $1 - last - 1; last = $1 }
    END { rest = NR ? n - last - 1 : n; print (rest > g ? rest : g + 0) }' "$1"
}

# returns OUTAGES ARRIVALS: median and worst of the seconds from an outage's end to the first frame behind
# it; `never` where none came any more, which is worse than any. OUTAGES: a file with a line CUT MENDED for
# each. Without one: - -
returns() {
  sort -k2n "$2" | awk 'FILENAME != "-" { mended[++n] = $2; next }
    { while (k < n && $2 > mended[k + 1]) printf "%.3f\n", $2 - mended[++k] }
    END { while (k++ < n) print "inf" }' "$1" - | sort -g |
    awk '{ v[NR] = $1 == "inf" ? "never" : $1 } END { print (NR ? v[int((NR + 1) / 2)] " " v[NR] : "- -") }'
}

# live_again OUTAGES ARRIVALS FPS: the same to the first frame that is at most 0.2 s later than the frame with the
# shortest way: from then on the stream is live.
live_again() {
  awk -v f="$3" '{ late = $2 - $1 / f; if (NR == 1 || late < least) least = late; line[NR] = $0; lateness[NR] = late }
    END { for (i = 1; i <= NR; ++i) if (lateness[i] <= least + 0.2) print line[i] }' "$2" | returns "$1" -
}

# summary_row NAME <SUMMARY: a row of peer_table.
summary_row() {
  awk -v n="$1" 'function s(v) { return v ~ /^[0-9]/ ? sprintf("%.2f", v) : v }
    { printf "| %s | %d | %s, %s | %s, %s | %.2f | %.0f | %d |\n", n, $1, s($2), s($3), s($4), s($5), $6, $7 / 1024, $8 }'
}

# summary_results CONTENDER <SUMMARY: RESULT lines; a return that never came is inf, and without an outage
# there is none.
summary_results() {
  awk -v p="RESULT paper.peer.$1" '{ printf "%s.longest_gap %d\n", p, $1
    if ($2 == "never") printf "%s.return_s inf\n", p
    else if ($2 != "-") printf "%s.return_s %.3f\n", p, $2
    if ($4 == "never") printf "%s.live_again_s inf\n", p
    else if ($4 != "-") printf "%s.live_again_s %.3f\n", p, $4
    printf "%s.cpu_ms_per_frame %.3f\n", p, $6 }'
}

# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# To be sourced by run.sh: its tables on one page. Wants `out`, `seed`, `full`, `mbit` and `traces`.

table() { # FILE: its lines, or that there are none
  if [ -s "$out/$1" ]; then cat "$out/$1"; else echo '(skipped: see what the command says)'; fi
  echo
}

write_report() {
  cat <<PAGE
Command: \`./dev bench paper${full:+ --full} --seed $seed\`; Linux $(uname -r), $(nproc) processors,
$(awk -F': ' '/model name/ { print $2; exit }' /proc/cpuinfo).

Unbroken, mono corridor and stereo street:

    $(grep -hs ^unbroken "$out/corridor.log")
    $(grep -hs ^unbroken "$out/street.log")

### How many frames in a row may be missing (sec. III-F)

PAGE
  table tolerance.md
  printf '### Outages along the way, simulated (sec. IV-A)\n\n'
  table interruption.md
  printf '### The buffer it takes (sec. IV-B, fig. "buf")\n\n'
  table buffer.md
  printf '### Outages of real processes over TCP, %s Mbit/s\n\n' "$mbit"
  table sessions.md
  table peers.md
  printf '### Links of moving cars, simulated (sec. IV-B)\n\n'
  table traces.md
  printf 'Time to enqueue a frame that costs another, from the street.log: %s\n' \
    "$(sed -n 's/^RESULT paper.enqueue.\([a-z]*\)_ms/\1/p' "$out/street.log" 2>/dev/null | paste -sd' ')"
}

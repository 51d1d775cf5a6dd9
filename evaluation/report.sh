# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# To be sourced by run.sh: its tables on one page. Wants `out`, `seed`, `full`, `only`, `mbit` and `failed`.

table() { # FILE [full]: its lines, or why there are none
  if [ -s "$out/$1" ]; then
    cat "$out/$1"
  elif [ -n "${2-}" ] && [ -z "$full" ]; then
    # shellcheck disable=SC2016 # Markdown
    echo '(`--full` has it)'
  elif [ -n "$only" ]; then
    echo "(skipped, or not of \`--only $only\`)"
  else
    echo '(skipped: see what the command says)'
  fi
  echo
}
plot() { # FILE WHAT
  [ ! -s "$out/$1" ] || printf '![%s](%s)\n\n' "$2" "$1"
}

write_report() {
  cat <<PAGE
Command: \`./dev bench paper${full:+ --full}${only:+ --only $only} --seed $seed\`; Linux $(uname -r), $(nproc) processors,
$(awk -F': ' '/model name/ { print $2; exit }' /proc/cpuinfo).

Unbroken, mono corridor and stereo street:

    $(grep -hs ^unbroken "$out"/{corridor,real}.log | head -n 1)
    $(grep -hs ^unbroken "$out"/{street,mobile}.log | head -n 1)

### How many frames in a row may be missing (sec. III-F)

PAGE
  table tolerance.md
  plot paper_tolerance.svg 'frames in a row that lose the reference VO'
  plot paper_similarity.svg 'similarity by distance'
  printf '### Outages along the way, simulated (sec. IV-A)\n\n'
  table interruption.md
  plot paper_interruption.svg 'outages survived'
  printf 'With JPEG of quality 10, over a link that is slower by as much:\n\n'
  table quality10/interruption.md full
  printf '### The buffer it takes (sec. IV-B, fig. "buf")\n\n'
  table buffer.md
  printf '### Outages of real processes over TCP, %s Mbit/s\n\n' "$mbit"
  table real/sessions.md
  table peers.md
  [ ${#failed[@]} -eq 0 ] || printf 'Failed, and stand in no table: %s.\n\n' "${failed[*]}"
  printf '### The same, 50 frames 1000 ms late instead (sec. IV-A)\n\n'
  table latency/sessions.md
  printf '### Links of moving cars, simulated (sec. IV-B)\n\n'
  table traces.md
  plot paper_buffers.svg 'ATE by buffer'
  printf '### Links of moving cars, real processes over TCP\n\n'
  table paths.md
  printf 'Time to enqueue a frame that costs another, from the street.log: %s\n' \
    "$(sed -n 's/^RESULT paper.enqueue.\([a-z]*\)_ms/\1/p' "$out/street.log" 2>/dev/null | paste -sd' ')"
  echo
  plot paper_enqueue.svg 'time to enqueue'
}

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Holds tests/README against the tree: each source of common/, daemon/, server/ and evaluation/ has a test of its name or stands
# in the list of those without; what that list and the list of folders name is there.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
shopt -s nullglob
bad=0
problem() { echo "tests/README: $1" >&2 && bad=1; }

# What stands before two blanks under "Sources without a twin": paths, with braces and stars.
declare -A listed=()
while read -r word; do
  [[ $word =~ ^[a-z0-9_/{},.*-]+$ ]] || { problem "not a path: $word" && continue; }
  for pattern in $(eval "echo $word"); do
    found=()
    for path in $pattern; do [ ! -e "$path" ] || found+=("$path"); done
    [ ${#found[@]} -gt 0 ] || problem "no $pattern"
    for path in "${found[@]}"; do listed[${path%/}]=1; done
  done
done < <(awk '/^Sources without a twin/ { on = 1; next } /^[^ ]/ { on = 0 }
  on && sub(/^  /, "") && /^[^ ]/ { sub(/  .*/, ""); gsub(/, /, "\n"); print }' tests/README)
[ ${#listed[@]} -gt 10 ] || problem 'finds no list of sources without a twin'

while read -r source; do
  [ ! -e "tests/${source%.cpp}_test.cpp" ] || continue
  path=$source
  until [ "$path" = . ] || [ -n "${listed[$path]-}" ]; do path=$(dirname "$path"); done
  [ "$path" != . ] || problem "no test and no line for $source"
done < <(find common daemon server evaluation -name '*.cpp' | sort)

while read -r name; do
  [ -e "tests/$name" ] || problem "no tests/$name"
done < <(awk '/^Sources without/ { exit } /^  [^ ]/ { print $1 }' tests/README)
exit $bad

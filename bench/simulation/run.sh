#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# 120 seeds, since so many in a row have their share of each kind, or seeds for some minutes; with --defects, also how
# soon the simulation finds the defects that the project had, in 3 minutes each or so many; with --chaos, which of them
# bench chaos finds.
# Usage: bench/simulation/run.sh BUILD_FOLDER [--minutes N] [--seed N] [--chaos] [--defects [NAME ...]]
# The defects are built in a work tree of its own, build/simulation-defects, which stays for the next time.
set -euo pipefail
build=$(cd "$1" && pwd)
shift
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
minutes='' seed=$(date +%s) chaos='' defects='' measure=(--seeds 120)
while [ $# -gt 0 ]; do
  case $1 in
    --minutes) minutes=$2 && shift 2 ;;
    --seed) seed=$2 && shift 2 ;;
    --chaos) chaos=1 && shift ;;
    --defects) defects=1 && shift && break ;;
    *) sed -n '6s/^# //p' "$0" >&2 && exit 2 ;;
  esac
done
simulate() { "$1/testing/simulation/orbbuf-simulate" --seed "$seed" "${@:2}"; }
if [ -z "$defects" ]; then
  [ -z "$chaos" ] || { echo "bench simulation: --chaos goes with --defects" >&2 && exit 2; }
  [ -z "$minutes" ] || measure=(--minutes "$minutes")
fi
status=0
simulate "$build" "${measure[@]}" --go-on || status=$?
[ -n "$defects" ] || exit $status

patches=$PWD/testing/simulation/defects tree=$PWD/build/simulation-defects
if [ $# -eq 0 ]; then
  for patch in "$patches"/*.patch; do set -- "$@" "$(basename "$patch" .patch)"; done
fi
[ -e "$tree" ] || git worktree add --detach "$tree" HEAD
git -C "$tree" checkout --quiet --detach "$(git rev-parse HEAD)"
git -C "$tree" checkout --quiet .
cmake -S "$tree" --preset dev -DORBBUF_BUILD_EVALUATION=OFF > /dev/null
head=$(git rev-parse HEAD:{common,daemon,server,testing/simulation} | tr '\n' ' ') programs=(daemon/orbbufd server/orbbuf-server
  testing/simulation/{orbbuf-simulate,orbbuf-stranger,liborbbuf-simulated.so})
found=0 chaos_found=0 times=()
for name; do # one tree for all, so that only what a patch touches is compiled
  stamp="$head $(sha256sum < "$patches/$name.patch")" copy=$tree/build/$name
  if [ "$(cat "$copy/stamp" 2> /dev/null)" != "$stamp" ]; then
    rm -rf "$copy"
    git -C "$tree" apply "$patches/$name.patch"
    built=0
    cmake --build "$tree/build/dev" --target orbbuf-simulate > "$tree/build/$name.log" 2>&1 || built=$?
    git -C "$tree" apply -R "$patches/$name.patch"
    if [ $built -ne 0 ]; then
      echo "$name: does not build; see $tree/build/$name.log"
      continue
    fi
    for program in "${programs[@]}"; do install -D "$tree/build/dev/$program" "$copy/$program"; done
    echo "$stamp" > "$copy/stamp"
  fi
  simulate "$copy" --minutes "${minutes:-3}" > "$copy.found" || true
  took=$(sed -n 's/^RESULT simulation.minutes //p' "$copy.found")
  if grep -aq '^  FOUND the simulator ended' "$copy.found"; then # that is no finding
    echo "$name: the simulator ended" && status=1
  elif grep -aq '^  FOUND' "$copy.found"; then
    found=$((found + 1)) times+=("$took")
    echo "$name: found after $took minutes: $(grep -am1 '^  FOUND' "$copy.found")"
  else
    echo "$name: not found in $took minutes"
  fi
  [ -n "$chaos" ] || continue
  ln -sfn "$build/bench" "$copy/bench"
  if bench/chaos/run.sh "$copy" --seed "$seed" > "$copy.chaos" 2>&1; then
    echo "$name: bench chaos does not find it"
  elif [ $? -eq 77 ]; then
    echo "$name: bench chaos cannot run here"
  else
    chaos_found=$((chaos_found + 1))
    echo "$name: bench chaos finds it; see $copy.chaos"
  fi
done
echo "RESULT simulation.defects $#"
echo "RESULT simulation.found_of_20 $found"
[ $found -eq 0 ] || echo "RESULT simulation.median_minutes_to_find $(printf '%s\n' "${times[@]}" | sort -n | sed -n "$(((found + 1) / 2))p")"
[ -z "$chaos" ] || echo "RESULT simulation.chaos_found_of_20 $chaos_found"
exit $status

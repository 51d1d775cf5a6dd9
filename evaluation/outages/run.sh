#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs a SLAM program on the frames of each list: run.sh PROGRAMS LISTS SEQUENCE RUNS CAMERA [COMMAND]. Writes its
# trajectory where `orbbuf-outages judge LISTS RUNS` looks for it, and its words beside it. COMMAND is that of
# `orbbuf-odometry --slam`; without it the reference VO runs. A list that has a trajectory or a log is not run again.
# A program that fails has no trajectory, and counts as lost.
set -euo pipefail
programs=$(realpath "$1") lists=$(realpath "$2") sequence=$(realpath "$3") runs=$(realpath -m "$4") camera=$(realpath "$5")
command=${6-}

run_list() { # LIST, under lists
  local name=${1%.csv} folder
  [ ! -e "$runs/$name.log" ] || return 0
  mkdir -p "$runs/$(dirname "$name")"
  folder=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-list.XXXXXX")
  if ! {
    "$programs/orbbuf-outages" folder "$lists/$1" "$sequence" "$folder" &&
      "$programs/orbbuf-odometry" "$folder" --camera "$camera" --trajectory "$runs/$name.txt" ${command:+--slam "$command"}
  } >"$folder/log" 2>&1; then
    rm -f "$runs/$name.txt"
  fi
  mv "$folder/log" "$runs/$name.log"
  rm -r "$folder"
}
export -f run_list
export programs lists sequence runs camera command
# shellcheck disable=SC2016 # for the inner shell
(cd "$lists" && find . -path "./$(basename "$sequence")/*" -name '*.csv' -printf '%P\n' | sort) |
  xargs -r -P "$(nproc)" -d '\n' -n 1 bash -c 'set -euo pipefail; run_list "$1"' run_list

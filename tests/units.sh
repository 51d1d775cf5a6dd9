#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Whether systemd takes the units, and how exposed it calls them: at most 1.5.
# Usage: tests/units.sh BUILD_FOLDER
set -euo pipefail
command -v systemd-analyze >/dev/null || { echo 'units: no systemd-analyze' && exit 77; }
build=$(cd "$1" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
bad=0
for unit in orbbufd orbbufd@ orbbuf-server; do
  program=$(find "$build/daemon/orbbufd" "$build/server/orbbuf-server" -name "${unit%@}")
  # The program where it was built, since it need not be installed here.
  sed "s|^ExecStart=[^ ]*|ExecStart=$program|" "$build/systemd/$unit.service" >"$work/$unit.service"
  said=$(systemd-analyze verify --man=no "$work/$unit.service" 2>&1) || bad=1
  [ -z "$said" ] || { echo "units: $unit: $said" >&2 && bad=1; }
  level=$(systemd-analyze security --no-pager --offline=true "$work/$unit.service" |
    sed -n 's/.*Overall exposure level for .*: \([0-9.]*\) .*/\1/p')
  echo "RESULT ship.security.$unit $level"
  awk -v level="$level" 'BEGIN { exit !(level != "" && level <= 1.5) }' || bad=1
done
exit $bad

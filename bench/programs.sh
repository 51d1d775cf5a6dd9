# shellcheck shell=bash disable=SC2034,SC2154
# SPDX-License-Identifier: Apache-2.0
# Sourced by benches that start the real programs. They set `name` before, and have the build folder in $1.
# Gives orbbufd, server, a folder `work`, which goes at the end, and functions; ends what is in `programs`.
orbbufd=$1/daemon/orbbufd server=$1/server/orbbuf-server
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-$name.XXXXXX")
programs=()
end() {
  [ ${#programs[@]} -eq 0 ] || kill "${programs[@]}" 2>/dev/null || true
  wait
  rm -rf "$work"
}
trap end EXIT

await() { # LOG TEXT
  for _ in {1..1200}; do
    ! grep -q "$2" "$1" || return 0
    sleep 0.1
  done
  echo "$name: no \"$2\" in $1" >&2 && tail -n 5 "$1" >&2
  return 1
}
serve() { # SETTING...: into $work/server.log; its address is in $address, its process in $server_pid
  local settings=() setting
  for setting in "$@"; do settings+=(--set "$setting"); done
  : >"$work/server.log" # before the new server does: the last one's address is in it
  "$server" "${settings[@]}" >>"$work/server.log" 2>&1 &
  server_pid=$!
  programs+=("$server_pid")
  await "$work/server.log" 'listening on '
  address=$(sed -n 's/.*listening on //p' "$work/server.log")
}
stop() { # PID [SIGNAL]: one of programs; it ends well, unless it is killed
  local i
  kill -s "${2:-TERM}" "$1"
  wait "$1" 2>/dev/null || [ "${2:-TERM}" = KILL ]
  for i in "${!programs[@]}"; do
    [ "${programs[i]}" != "$1" ] || unset "programs[i]"
  done
}

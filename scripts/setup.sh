#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# orbbufd setup [--server HOST[:PORT]] [--camera CAMERA] [--folder FOLDER] [--force] [ROBOT.tar]: asks for what the
# options do not say, checks server, camera and machine (orbbufd --probe), and writes FOLDER/orbbufd.toml.
set -euo pipefail
umask 077
fail() { echo "setup: $1" >&2 && exit 1; }
program=$1 folder=/etc/orbbuf server='' camera='' force='' made=''
shift
while [ $# -gt 0 ]; do
  case $1 in
    --server) server=${2-} && shift ;;
    --camera) camera=${2-} && shift ;;
    --folder) folder=${2-} && shift ;;
    --force) force=1 ;;
    -*) fail "unknown option $1; see orbbufd setup --help" ;;
    *) made=$1 ;;
  esac
  shift
done
[ -w "$folder" ] || fail "cannot write to $folder; run it with sudo, or set --folder"
folder=$(cd "$folder" && pwd)
work=$(mktemp -d "$folder/setup.XXXXXX")
config=$work.toml # in the same folder, where its relative paths start
trap 'rm -rf "$work" "$config"' EXIT

if [ -e "$folder/libcamera.env" ]; then # as the unit reads it
  set -a
  # shellcheck source=/dev/null
  . "$folder/libcamera.env"
  set +a
fi

# ask QUESTION DEFAULT
ask() {
  local answer
  read -r -p "$1 [$2]: " answer || true
  echo "${answer:-$2}"
}
# announced: HOST:PORT of each server that avahi-daemon hears of; its address, where the resolver does not know its name.
announced() {
  command -v avahi-browse >/dev/null || return 0
  local name address port
  { avahi-browse --resolve --parsable --terminate _orbbuf._tcp 2>/dev/null || true; } |
    awk -F ';' '$1 == "=" && $3 == "IPv4" { print $7, $8, $9 }' | sort -u | while read -r name address port; do
    ! getent ahosts "$name" >/dev/null || address=$name
    echo "$address:$port"
  done
}
# put TABLE KEY TEXT, put_value TABLE KEY VALUE: in the configuration, where the key is, or at the head of its table.
put() { put_value "$1" "$2" "\"$3\""; }
put_value() {
  grep -qF "[$1]" "$config" || printf '\n[%s]\n' "$1" >>"$config"
  TABLE="[$1]" KEY=$2 VALUE=$3 awk '
    function line(rest) { done = 1; print ENVIRON["KEY"] " = " ENVIRON["VALUE"] rest }
    FNR == NR { if (/^\[/) here = $1; if (here == ENVIRON["TABLE"] && $1 == ENVIRON["KEY"]) is_there = 1; next }
    FNR == 1 { here = "" }
    /^\[/ { here = $1 }
    here == ENVIRON["TABLE"] && $1 == ENVIRON["KEY"] && !done {
      sub(/^[^=]*= *("[^"]*"|\[[^]]*\]|[^ ]*)/, "")
      line($0)
      next
    }
    { print }
    !is_there && !done && here == ENVIRON["TABLE"] { line("") }' "$config" "$config" >"$work/new"
  mv "$work/new" "$config"
}
# get KEY FILE: the first string that a line sets for the key.
get() { sed -nE "s/^$1 = \"([^\"]*)\".*/\1/p" "$2" | head -n 1; }

[ ! -e "$folder/orbbufd.toml" ] || cp "$folder/orbbufd.toml" "$config"
touch "$config"
for file in orbbufd.crt orbbufd.key ca.crt; do [ ! -e "$folder/$file" ] || cp "$folder/$file" "$work/"; done
list= # of servers, which stays if --server names none
! grep -qE '^ *server *= *\[' "$config" || list=1
if [ -n "$made" ]; then
  mkdir "$work/made"
  tar -C "$work/made" --no-same-owner -xf "$made" orbbufd.toml orbbufd.crt orbbufd.key ca.crt || fail "$made: not made by orbbuf-server add-robot"
  [ ! -e "$folder/ca.key" ] || cmp -s "$work/made/ca.crt" "$folder/ca.crt" ||
    fail "$made is not of this machine's own CA, $folder/ca.key, whose ca.crt it would replace; set --folder, and LoadCredential= of the service"
  mv "$work"/made/*.{crt,key} "$work/"
  [ -n "$list" ] || : "${server:=$(get server "$work/made/orbbufd.toml")}"
  put robot id "$(get id "$work/made/orbbufd.toml")"
  put tls certificate credential:certificate
  put tls key credential:key
  put tls ca credential:ca
fi
if [ -z "$server$list" ]; then
  server=$(get server "$config")
  mapfile -t found < <(announced)
  [ ${#found[@]} -eq 0 ] || printf 'found by mDNS: %s\n' "${found[@]}"
  case $server in '' | 127.0.0.1:7722) server=${found[0]-$server} ;; esac # the sample's
  server=$(ask 'Server, HOST or HOST:PORT' "$server")
fi
if [ -n "$server" ]; then
  [[ $server =~ :[0-9]+$ ]] || server=$server:7722
  put link server "$server"
fi

if [ -z "$camera" ]; then
  "$program" --list-cameras | grep -v '^ ' || true
  camera=$(ask 'Camera: a device such as /dev/video0, libcamera:ID, or generated for a drawn scene' /dev/video0)
fi
case $camera in
  /*) put source kind v4l2 && put source device "$camera" ;;
  libcamera:?*) put source kind libcamera && put source camera "${camera#*:}" ;;
  generated)
    put source kind generated
    # A sensor of the drawn scene moves with it, once.
    awk '/^\[/ { here = $1 } here ~ /^\[stream\./ && /^kind *= *"generated"/ { found = 1 } END { exit !found }' "$config" ||
      put_value source loop true
    ;;
  *) fail "expected /dev/..., libcamera:ID or generated, not $camera" ;;
esac

mkdir "$work/credentials"
ln -s "$work/orbbufd.crt" "$work/credentials/certificate"
ln -s "$work/orbbufd.key" "$work/credentials/key"
ln -s "$work/ca.crt" "$work/credentials/ca"
export CREDENTIALS_DIRECTORY=$work/credentials
"$program" --check-config --config "$config" >/dev/null || fail "$folder/orbbufd.toml stays as it was"
if ! "$program" --probe --config "$config" && [ -z "$force" ]; then
  [[ $(ask 'Write the configuration all the same? y or n' n) == y* ]] || fail "$folder/orbbufd.toml stays as it was"
fi
[ ! -e "$folder/orbbufd.toml" ] || cp -p "$folder/orbbufd.toml" "$folder/orbbufd.toml.old"
chmod 644 "$config"
for file in "$work"/*.{crt,key}; do [ ! -e "$file" ] || mv "$file" "$folder/"; done
mv "$config" "$folder/orbbufd.toml"
start='enable --now'
! systemctl is-active --quiet orbbufd 2>/dev/null || start=restart
echo "wrote $folder/orbbufd.toml; now run systemctl $start orbbufd"

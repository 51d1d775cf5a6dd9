#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# orbbuf-server doctor [--config FILE], and what orbbufd --probe says of the machine: a line for each thing that is
# wrong, with what to do. Exit status 1: something is.
set -euo pipefail
program=$1 name=${1##*/}
config=/etc/orbbuf/$name.toml
shift
while [ $# -gt 0 ]; do
  case $1 in
    --config) config=${2-} && shift ;;
    *) echo "doctor: unknown option $1" >&2 && exit 2 ;;
  esac
  shift
done
bad=0
wrong() { echo "wrong: $1" && bad=1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# values TABLE.KEY DEFAULT: the strings that the configuration sets for the key, a line each.
values() {
  { [ ! -r "$config" ] || awk -v wanted="$1" '
      /^ *\[/ { table = $0; gsub(/^ *\[|\].*/, "", table); table = table "."; next }
      { key = $1; sub(/=.*/, "", key) }
      table key == wanted { while (/= *\[[^]]*$/ && (getline line) > 0) { sub(/#.*/, "", line); $0 = $0 " " line } }
      table key == wanted { sub(/^[^=]*= */, ""); match($0, /^("[^"]*"|\[[^]]*\]|[^ ]*)/); print substr($0, 1, RLENGTH) }' "$config"; } |
    { grep -oE '"[^"]*"' || echo "\"$2\""; } | tr -d '"'
}
value() { values "$1" "$2" | head -n 1; }

# The configuration, with the credentials that the service gets.
folder=$(dirname "$config") own=$(basename "$config" .toml)
[ "$name" = orbbufd ] || own=server
if [ -z "${CREDENTIALS_DIRECTORY-}" ]; then # orbbufd setup has it
  export CREDENTIALS_DIRECTORY=$work
  for link in "certificate $own.crt" "key $own.key" "ca ca.crt"; do
    ln -s "$(realpath -m "$folder/${link#* }")" "$work/${link% *}"
  done
fi
file_of() { # KEY: the file that tls.KEY names; nothing if it names none
  local text
  text=$(value "tls.$1" '')
  case $text in
    '') ;;
    credential:*) realpath -m "$CREDENTIALS_DIRECTORY/${text#*:}" ;;
    *) (cd "$folder" && realpath -m "$text") ;;
  esac
}
if [ ! -r "$config" ]; then
  wrong "configuration: cannot read $config; run this with sudo, or give --config FILE"
elif ! said=$("$program" --check-config --config "$config" 2>&1); then
  wrong "configuration: ${said##*$'\n'}"
fi

for key in certificate key ca; do
  file=$(file_of "$key")
  [ -n "$file" ] || continue
  if [ ! -r "$file" ]; then
    wrong "permissions: cannot read tls.$key, $file; run this with sudo, or make it: orbbuf-server add-robot --help"
  elif [ "$key" = key ] && [ $((0$(stat -Lc %a "$file") & 7)) -ne 0 ]; then
    wrong "permissions: other users have access to the key $file; run chmod 600 $file"
  elif [ "$key" != key ] && command -v openssl >/dev/null && ! openssl x509 -in "$file" -noout -checkend 2592000 >/dev/null; then
    wrong "certificate: $file $(openssl x509 -in "$file" -noout -enddate | sed 's/notAfter=/ends on /'); make a new one (docs/security.md)"
  fi
done

if [ "$(date +%s)" -lt "$(stat -c %Y "$program")" ]; then
  wrong "clock: it is $(date -u +%F), before this program was made; set the clock, or connect to the network"
elif [ "$(timedatectl show -p NTPSynchronized --value 2>/dev/null)" = no ]; then
  wrong 'clock: no NTP client keeps it, so capture times are as wrong as the clock; run timedatectl set-ntp true, or apt install chrony'
fi

if command -v iw >/dev/null; then
  for interface in $(iw dev | awk '$1 == "Interface" { print $2 }'); do
    [[ $(iw dev "$interface" get power_save) != *': on' ]] ||
      wrong "power saving: $interface sleeps between packets, which costs tenths of a second; run iw dev $interface set power_save off, and at each start: nmcli connection modify NAME 802-11-wireless.powersave 2"
  done
elif compgen -G '/sys/class/net/*/wireless' >/dev/null; then
  echo 'not known: whether the Wi-Fi saves power; apt install iw'
fi

# disk KEY FOLDER: of a folder that the service makes if it is missing.
disk() {
  local path=$2 free
  [[ $path == /* ]] || path=$folder/$path
  while [ ! -e "$path" ]; do path=$(dirname "$path"); done
  [ -w "$path" ] || wrong "permissions: $1, $2: cannot write there; run this with sudo, or change the owner"
  free=$(df -Pm "$path" | awk 'END { print $4 }')
  [ "$free" -ge 1024 ] || wrong "disk: $1, $2: only $free MiB are free; remove files, or set $3"
}

# reach HOST:PORT: whether something listens there.
reach() {
  local host=${1%:*}
  host=${host#[} host=${host%]}
  timeout 3 bash -c "</dev/tcp/$host/${1##*:}" 2>/dev/null
}

if [ "$name" = orbbufd ]; then
  spool=$(value spool.path '')
  [ -z "$spool" ] || disk spool.path "$spool" spool.size
  kind=$(value source.kind generated) device=$(value source.device /dev/video0)
  if [ "$kind" = v4l2 ] && [ ! -e "$device" ]; then
    wrong "camera: no $device; connect it, or set source.device to one that orbbufd --list-cameras prints"
  elif [ "$kind" = v4l2 ] && [ ! -r "$device" ]; then
    wrong "permissions: cannot read $device; run usermod -a -G video $(id -un), and log in again"
  fi
  for server in $(values link.server 127.0.0.1:7722); do
    reach "$server" || wrong "address: nothing answers at $server (link.server); start the server there, and look at its listen.address and firewall"
  done
else
  disk files.path "$(value files.path orbbuf-data)" files.keep_size
  listen=$(value listen.address 127.0.0.1:7722)
  host=${listen%:*}
  case $host in
    127.* | localhost | '[::1]') wrong "address: the server listens on $listen, where only this machine reaches it; run orbbuf-server add-robot, or set listen.address" ;;
    0.0.0.0 | '[::]') host=127.0.0.1 ;;
    *) [[ " $(hostname -I) " == *" ${host//[\[\]]/} "* ]] || [[ ! $host =~ ^[][0-9.:]+$ ]] ||
      wrong "address: this machine has no address $host (listen.address); it has $(hostname -I)" ;;
  esac
  reach "$host:${listen##*:}" || wrong "address: no server listens at $listen; run systemctl status orbbuf-server"
fi
[ $bad -eq 1 ] || echo 'nothing is wrong with configuration, clock, power saving, disk, permissions, addresses'
exit $bad

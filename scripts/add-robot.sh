#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# orbbuf-server add-robot [--server HOST[:PORT]] [--folder FOLDER] ROBOT. docs/security.md has the same commands of
# openssl, for a CA on another machine.
set -euo pipefail
umask 077
fail() { echo "add-robot: $1" >&2 && exit 1; }

program=$1 folder=/etc/orbbuf server='' robot=''
shift
while [ $# -gt 0 ]; do
  case $1 in
    --server) server=${2-} && shift ;;
    --folder) folder=${2-} && shift ;;
    -*) fail "unknown option $1; see orbbuf-server add-robot --help" ;;
    *) [ -z "$robot" ] || fail "one robot at a time, not $robot and $1" && robot=$1 ;;
  esac
  shift
done
[[ $robot =~ ^[A-Za-z0-9_][A-Za-z0-9._-]{0,63}$ ]] ||
  fail "expected the robot's id: 1 to 64 characters of A-Z a-z 0-9 . _ -, the first a letter, a digit or _, not \"$robot\""
command -v openssl >/dev/null || fail 'needs openssl: apt install openssl'
[ -w "$folder" ] || fail "cannot write to $folder; run it with sudo, or set --folder"
folder=$(cd "$folder" && pwd)
config=$folder/orbbuf-server.toml
[ -f "$config" ] || fail "no $config"
made=$folder/robots/$robot.tar
[ ! -e "$made" ] || fail "$made is there already; to make new keys for this robot, remove it first"
addresses=$(hostname -I 2>/dev/null || true)
: "${server:=${addresses%% *}}"
[ -n "$server" ] || fail 'this machine has no address; set --server to where robots will reach it'
[[ $server != *:*:* || $server == \[* ]] || server="[$server]"
port=$(sed -nE 's/^address = ".*:([0-9]+)".*/\1/p' "$config" | head -n 1)
[[ $server =~ ^(\[.*\]|[^:]*):[0-9]+$ ]] || server=$server:${port:-7722}
host=${server%:*}
host=${host#[}
host=${host%]}
host=${host%%%*} # the zone is the robot's matter: no certificate has it

# All is made here, and moved into the folder at the end.
work=$(mktemp -d "$folder/add-robot.XXXXXX")
trap 'rm -rf "$work" "$config.new"' EXIT
for file in ca.crt ca.key server.crt server.key; do [ ! -e "$folder/$file" ] || cp "$folder/$file" "$work/"; done
named() { if [[ $1 =~ ^[0-9.]+$ || $1 == *:* ]]; then echo "IP:$1"; else echo "DNS:$1"; fi; }
# is_ipv6: robots reach the server over IPv6 alone.
is_ipv6() {
  [[ $host != *:* ]] || return 0
  ! getent ahostsv4 "$host" >/dev/null 2>&1 && getent ahostsv6 "$host" >/dev/null 2>&1
}
# sign NAME SUBJECT EXTENSION: a certificate NAME.crt for the key NAME.key of the folder $work, which it makes if it is missing.
sign() {
  [ -e "$work/$1.key" ] || openssl ecparam -name prime256v1 -genkey -noout -out "$work/$1.key"
  { openssl req -new -key "$work/$1.key" -subj "/CN=$2" "${@:3}" -out "$work/$1.csr" &&
    openssl x509 -req -in "$work/$1.csr" -copy_extensions copy -days 825 -CA "$work/ca.crt" -CAkey "$work/ca.key" \
      -CAcreateserial -CAserial "$work/serial" -out "$work/$1.crt"; } 2>"$work/log" ||
    fail "cannot make the certificate of $2: $(cat "$work/log")"
}
# value TABLE KEY: as $work/toml has it; nothing if it is not there, or an empty string.
value() {
  awk -v table="[$1]" -v key="$2" '
    /^ *\[/ { here = $1 }
    here == table && $0 ~ "^ *" key " *=" { sub(/^[^=]*= */, ""); sub(/^"/, ""); sub(/".*/, ""); print; exit }' "$work/toml"
}

new=() said=() note='' any=0.0.0.0
! is_ipv6 || any='[::]' # which takes IPv4, too
is_first=
[ -e "$folder/ca.crt" ] || [ -e "$folder/server.crt" ] || is_first=1
cp "$config" "$work/toml"
if [ -n "$is_first" ]; then
  sed -i -e '/^\[tls\]/,/^\[/{s/^certificate = ""/certificate = "credential:certificate"/
    s/^key = ""/key = "credential:key"/;s/^ca = ""/ca = "credential:ca"/}' \
    -e '/^\[listen\]/,/^\[/s/^address = "127\.0\.0\.1:/address = "'"$any"':/' \
    -e '/^\[http\]/,/^\[/s/^address = ""/address = "127.0.0.1:7723"/' "$work/toml"
  for key in certificate key ca; do
    [ -n "$(value tls $key)" ] || fail "$config is not as it was installed: in [tls], set $key = \"credential:$key\""
  done
  case $(value listen address) in
    '' | 127.* | localhost:* | '[::1]'*) fail "$config is not as it was installed: in [listen], set address = \"$any:7722\"" ;;
  esac
  openssl req -x509 -new -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 3650 -subj '/CN=ORBBuf CA' \
    -keyout "$work/ca.key" -out "$work/ca.crt" 2>/dev/null
  sign viewer viewer -addext extendedKeyUsage=clientAuth
  openssl pkcs12 -export -in "$work/viewer.crt" -inkey "$work/viewer.key" -passout pass: -out "$work/viewer.p12"
  new+=(ca.key ca.crt viewer.p12 orbbuf-server.toml)
  said+=("$config: set [tls], listen.address and http.address"
    "$folder/ca.key: the key of the CA; its owner can act as any robot"
    "$folder/viewer.p12: for a browser, which shows https://localhost:7723 with it; without password")
elif [ ! -e "$folder/ca.key" ]; then
  fail "no $folder/ca.key: make the robot's certificate where the key of your CA is (docs/security.md)"
elif [ "$any" != 0.0.0.0 ] && [[ $(value listen address) == 0.0.0.0:* ]]; then
  sed -i '/^\[listen\]/,/^\[/s/^\( *address *= *"\)0\.0\.0\.0:/\1[::]:/' "$work/toml"
  new+=(orbbuf-server.toml)
  said+=("$config: set listen.address to [::], for robots that reach the server over IPv6")
  note='; then run systemctl restart orbbuf-server, for its new address'
fi
if [ ! -e "$work/server.crt" ]; then
  names=DNS:localhost,IP:127.0.0.1,DNS:$(hostname),DNS:$(hostname).local
  for address in $addresses; do names+=,$(named "$address"); done
else
  names=$(openssl x509 -in "$work/server.crt" -noout -ext subjectAltName | sed '1d; s/IP Address:/IP:/g; s/ //g')
fi
kind=$(named "$host")
if [ ! -e "$work/server.crt" ] || [ "$(openssl x509 -in "$work/server.crt" -noout \
  "-check$(case $kind in IP:*) echo ip ;; *) echo host ;; esac)" "$host" | grep -c 'does match')" -eq 0 ]; then
  [[ ,$names, == *,$kind,* ]] || names+=,$kind
  sign server orbbuf-server -addext "subjectAltName=$names" -addext extendedKeyUsage=serverAuth
  new+=(server.key server.crt)
  if [ -e "$folder/server.crt" ] || systemctl is-active --quiet orbbuf-server 2>/dev/null; then
    note='; then run systemctl restart orbbuf-server, for its new certificate'
  fi
fi

sign orbbufd "$robot" -addext extendedKeyUsage=clientAuth
cat >"$work/orbbufd.toml" <<TOML
# Made by orbbuf-server add-robot. man orbbufd.toml has all settings.
[robot]
id = "$robot"

[source]
kind = "v4l2"

[link]
server = "$server"

[tls]
certificate = "credential:certificate"
key = "credential:key"
ca = "credential:ca"
TOML
tar -C "$work" --owner=root:0 --group=root:0 -cf "$work/robot.tar" orbbufd.toml orbbufd.key orbbufd.crt ca.crt

# The configuration as the service will have it, in its folder, where its relative paths start.
cp -p "$config" "$config.new"
cat "$work/toml" >"$config.new"
ln -s server.crt "$work/certificate"
ln -s server.key "$work/key"
ln -s ca.crt "$work/ca"
CREDENTIALS_DIRECTORY=$work "$program" --check-config --config "$config.new" >/dev/null || fail "$config stays as it was"
! grep -E '^ *robots *= *\[' "$config" | grep -qvE '\[ *\]' || note+="; add \"$robot\" to listen.robots in $config"

mkdir -p "$folder/robots"
mv "$config.new" "$work/orbbuf-server.toml"
for file in "${new[@]}"; do mv "$work/$file" "$folder/$file"; done
mv "$work/robot.tar" "$made"
[ ${#said[@]} -eq 0 ] || printf '%s\n' "${said[@]}"
echo "$made: copy it to the robot and run there: sudo orbbufd setup $robot.tar$note"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The subcommands that are scripts: orbbuf-server add-robot and doctor, orbbufd setup and doctor, on a server and a
# robot that run with what they make. iw, timedatectl and df are stand-ins. Usage: tests/scripts.sh BUILD_FOLDER
set -euo pipefail
build=$(cd "$1" && pwd)
server=$build/server/orbbuf-server robot=$build/daemon/orbbufd
work=$(mktemp -d)
running=
trap '[ -z "$running" ] || { kill -KILL "$running" && wait; } 2>/dev/null; rm -rf "$work"' EXIT
bad=0
# says STATUS TEXT COMMAND...: that it ends with this status (0 or 1), and prints the text.
says() {
  local said status=0
  said=$("${@:3}" 2>&1 </dev/null) || status=1
  [ $status -eq "$1" ] && [[ $said == *"$2"* ]] && return
  printf 'scripts: status %s, or not "%s", from: %s\n%s\n' $status "$2" "${*:3}" "$(tail -n 5 <<<"$said")" >&2 && bad=1
}
expect() { says 0 "$@"; }
refused() { says 1 "$@"; }

# A machine on which nothing is wrong; each file of $work/machine spoils one thing.
mkdir "$work/bin" "$work/machine" "$work/etc" "$work/robot"
cat >"$work/bin/iw" <<FAKE
#!/bin/sh
if [ "\$#" = 1 ]; then printf 'phy#0\n\tInterface wlan7\n'; elif [ -e $work/machine/saves ]; then echo 'Power save: on'; else echo 'Power save: off'; fi
FAKE
cat >"$work/bin/timedatectl" <<FAKE
#!/bin/sh
if [ -e $work/machine/clock ]; then echo no; else echo yes; fi
FAKE
cat >"$work/bin/df" <<FAKE
#!/bin/sh
if [ -e $work/machine/full ]; then free=17; else free=9999; fi
printf 'Filesystem 1048576-blocks Used Available Capacity Mounted on\ndisk 9 9 %s 9%% /\n' \$free
FAKE
cat >"$work/bin/avahi-browse" <<FAKE
#!/bin/sh
printf '%s\n' '+;eth0;IPv4;ORBBuf on slam;_orbbuf._tcp;local' \
  '=;eth0;IPv4;ORBBuf on slam;_orbbuf._tcp;local;no-such-name.invalid;192.0.2.7;7722;' \
  '=;eth0;IPv6;ORBBuf on slam;_orbbuf._tcp;local;no-such-name.invalid;fe80::1;7722;' \
  "=;lo;IPv4;ORBBuf on here;_orbbuf._tcp;local;localhost;127.0.0.1;\$(cat $work/port);"
FAKE
cat >"$work/bin/systemctl" <<FAKE
#!/bin/sh
[ -e $work/machine/runs ]
FAKE
chmod +x "$work"/bin/*
PATH=$work/bin:$PATH

# The first robot: a CA, the server's keys and configuration, with a free port in place of 7722.
sed "s|^path = .*|path = \"$work/frames\"|; s|^socket = .*|socket = \"$work/socket\"|" "$build/systemd/orbbuf-server.toml" >"$work/etc/orbbuf-server.toml"
refused "expected the robot's id" "$server" add-robot --folder "$work/etc" ../escape
refused "expected the robot's id" "$server" add-robot --folder "$work/etc"
cp "$work/etc/orbbuf-server.toml" "$work/installed.toml"
sed -i 's/^key = ""/key=""/' "$work/etc/orbbuf-server.toml" # a user's way to write
refused 'in [tls], set key = "credential:key"' "$server" add-robot --folder "$work/etc" --server localhost r1
sed 's/^address = "127/address="127/' "$work/installed.toml" >"$work/etc/orbbuf-server.toml"
refused 'in [listen], set address = "0.0.0.0:7722"' "$server" add-robot --folder "$work/etc" --server localhost r1
[ "$(ls "$work/etc")" = orbbuf-server.toml ] || { echo 'scripts: refused, and yet it left keys' >&2 && bad=1; }
sed '/^robots = /d' "$work/installed.toml" >"$work/etc/orbbuf-server.toml" # the same as []: all may connect
touch "$work/machine/runs"
expect "orbbufd setup r1.tar; then run systemctl restart" "$server" add-robot --folder "$work/etc" --server localhost r1
rm "$work/machine/runs"
refused 'r1.tar is there already' "$server" add-robot --folder "$work/etc" --server localhost r1
expect '0.0.0.0:7722' grep '^address' "$work/etc/orbbuf-server.toml"
expect 'localhost:7722' tar -xOf "$work/etc/robots/r1.tar" orbbufd.toml
[ -z "$(find "$work/etc" -type f ! -name '*.toml' -perm /077)" ] || { echo 'scripts: others can read a key' >&2 && bad=1; }

# A second one reaches the server by another name, which its certificate gets besides those that it has.
cp "$work/etc/server.key" "$work/server.key"
expect 'systemctl restart orbbuf-server' "$server" add-robot --folder "$work/etc" --server slam.example:1234 r2
expect 'slam.example:1234' tar -xOf "$work/etc/robots/r2.tar" orbbufd.toml
for name in localhost slam.example; do
  expect 'does match' openssl x509 -in "$work/etc/server.crt" -noout -checkhost $name
done
cmp "$work/server.key" "$work/etc/server.key" || bad=1
for robots in '[]' '["r1"]'; do
  sed -i "/^robots = /d; s/^\\[listen\\]/&\nrobots = $robots/" "$work/etc/orbbuf-server.toml"
  "$server" add-robot --folder "$work/etc" --server localhost r4 >"$work/said"
  [ "$(grep -c 'listen.robots' "$work/said")" -eq "$(grep -c r1 <<<"$robots")" ] || { cat "$work/said" >&2 && bad=1; }
  rm "$work/etc/robots/r4.tar"
done
sed -i '/^robots = /d' "$work/etc/orbbuf-server.toml"
mv "$work/etc/ca.key" "$work/ca.key"
refused 'where the key of your CA is' "$server" add-robot --folder "$work/etc" --server localhost r3
mv "$work/ca.key" "$work/etc/ca.key"

# Over IPv6 alone: listen on [::], which takes IPv4, too; a zone is for the robot's configuration, not for the certificate.
mkdir "$work/v6"
cp "$work/installed.toml" "$work/v6/orbbuf-server.toml"
expect 'r1.tar: copy it' "$server" add-robot --folder "$work/v6" --server 'fe80::1%eth0' r1
expect '"[::]:7722"' grep '^address' "$work/v6/orbbuf-server.toml"
expect 'server = "[fe80::1%eth0]:7722"' tar -xOf "$work/v6/robots/r1.tar" orbbufd.toml
expect 'does match' openssl x509 -in "$work/v6/server.crt" -noout -checkip fe80::1
sed -i 's/"\[::\]:7722"/"0.0.0.0:7722"/' "$work/v6/orbbuf-server.toml" # made for robots with IPv4
expect 'for its new ' "$server" add-robot --folder "$work/v6" --server '[fd00::2]' r2
expect '"[::]:7722"' grep '^address' "$work/v6/orbbuf-server.toml"
expect 'server = "[fd00::2]:7722"' tar -xOf "$work/v6/robots/r2.tar" orbbufd.toml

# Nothing is written unless all can be.
mkdir "$work/half"
cp "$work/installed.toml" "$work/half/orbbuf-server.toml"
refused 'cannot make the certificate of orbbuf-server' "$server" add-robot --folder "$work/half" --server '[fe80::zz]' r1
echo 'no_such_key = 1' >>"$work/half/orbbuf-server.toml"
before=$(cat "$work/half/orbbuf-server.toml")
refused 'orbbuf-server.toml stays as it was' "$server" add-robot --folder "$work/half" --server localhost r1
[ "$(ls "$work/half")" = orbbuf-server.toml ] || { echo 'scripts: refused, and yet it left a part' >&2 && bad=1; }
[ "$before" = "$(cat "$work/half/orbbuf-server.toml")" ] || { echo 'scripts: refused, and yet it changed the file' >&2 && bad=1; }

# The server, as its service starts it.
mkdir "$work/credentials"
ln -s "$work/etc/server.crt" "$work/credentials/certificate"
ln -s "$work/etc/server.key" "$work/credentials/key"
ln -s "$work/etc/ca.crt" "$work/credentials/ca"
CREDENTIALS_DIRECTORY=$work/credentials "$server" --config "$work/etc/orbbuf-server.toml" --set listen.address=127.0.0.1:0 \
  --set http.address=127.0.0.1:0 2>"$work/server.log" &
running=$!
timeout 60 bash -c "until grep -q 'listening on' $work/server.log; do read -r -t 0.05 <> <(:) || true; done"
port=$(sed -nE 's/.*with TLS, listening on .*:([0-9]+).*/\1/p' "$work/server.log")
sed -i "s/^address = \"0.0.0.0:7722\"/address = \"0.0.0.0:$port\"/" "$work/etc/orbbuf-server.toml"

echo "$port" >"$work/port"

# The robot: answers from a pipe, then options alone.
cp "$build/systemd/orbbufd.toml" "$work/robot/"
printf 'localhost:%s\ngenerated\n' "$port" | "$robot" setup --folder "$work/robot" >"$work/said" 2>&1 || { cat "$work/said" >&2 && bad=1; }
expect "wrote $work/robot/orbbufd.toml" cat "$work/said"
expect 'captured: ' cat "$work/said"
expect "server = \"localhost:$port\"   # HOST:PORT" cat "$work/robot/orbbufd.toml"

# Servers that mDNS finds are shown, by name if it is known; the first one is suggested in place of the sample's.
mkdir "$work/found"
cp "$build/systemd/orbbufd.toml" "$work/found/"
printf '\ngenerated\n' | "$robot" setup --folder "$work/found" >"$work/said" 2>&1 || { cat "$work/said" >&2 && bad=1; }
expect 'found by mDNS: 192.0.2.7:7722' cat "$work/said"
expect "server = \"localhost:$port\"" cat "$work/found/orbbufd.toml"
before=$(cat "$work/robot/orbbufd.toml")
refused "nothing answers at localhost:1 (link.server)" "$robot" setup --folder "$work/robot" --server localhost:1 --camera generated
refused "cannot open" "$robot" setup --folder "$work/robot" --server "localhost:$port" --camera /dev/no-camera
refused "expected /dev/..., libcamera:ID or generated" "$robot" setup --folder "$work/robot" --server "localhost:$port" --camera webcam
[ "$before" = "$(cat "$work/robot/orbbufd.toml")" ] || { echo 'scripts: a refused configuration is written' >&2 && bad=1; }
expect "wrote $work/robot/orbbufd.toml" "$robot" setup --folder "$work/robot" --server localhost:1 --camera generated --force
expect "wrote $work/robot/orbbufd.toml" "$robot" setup --folder "$work/robot" --server "localhost:$port" --camera generated "$work/etc/robots/r1.tar"
mkdir "$work/empty" # no configuration before
expect "wrote $work/empty/orbbufd.toml" "$robot" setup --folder "$work/empty" --server "localhost:$port" --camera generated "$work/etc/robots/r2.tar"
expect 'id = "r2"' cat "$work/empty/orbbufd.toml"
expect 'loop = true' cat "$work/empty/orbbufd.toml"

# What the user wrote stays: a list of servers, a path beside the file. What orbbufd cannot read is not written.
mkdir "$work/user"
printf '[camera]\ncalibration = "camera.txt"\n[link]\nserver = ["localhost:%s", "127.0.0.1:%s"]\n' "$port" "$port" >"$work/user/orbbufd.toml"
printf '500 500 320 240 0\n640 480\nnone\n640 480\n' >"$work/user/camera.txt"
touch "$work/machine/runs"
expect "now run systemctl restart orbbufd" "$robot" setup --folder "$work/user" --camera generated
rm "$work/machine/runs"
expect "server = [\"localhost:$port\", " cat "$work/user/orbbufd.toml"
mkdir "$work/list" # over several lines, and with a robot's new certificate
printf '[link]\nserver = [\n  "localhost:%s",\n  "127.0.0.1:%s",\n]\n' "$port" "$port" >"$work/list/orbbufd.toml"
expect "wrote $work/list/orbbufd.toml" "$robot" setup --folder "$work/list" --camera generated "$work/etc/robots/r2.tar"
expect "\"127.0.0.1:$port\"," cat "$work/list/orbbufd.toml"
echo 'no_such_key = 1' >>"$work/user/orbbufd.toml"
before=$(cat "$work/user/orbbufd.toml")
refused "orbbufd.toml stays as it was" "$robot" setup --folder "$work/user" --camera generated --force
[ "$before" = "$(cat "$work/user/orbbufd.toml")" ] || { echo 'scripts: an invalid configuration is written' >&2 && bad=1; }
sed -i '/no_such_key/d' "$work/user/orbbufd.toml"
touch "$work/user/ca.key" "$work/user/ca.crt"
refused "not of this machine's own CA" "$robot" setup --folder "$work/user" --camera generated --force "$work/etc/robots/r1.tar"
expect 'id = "r1"' cat "$work/robot/orbbufd.toml"
[ -z "$(find "$work"/{robot,user} -name 'setup.*')" ] || { echo 'scripts: setup leaves a file' >&2 && bad=1; }

# Frames arrive with TLS.
mkdir "$work/own"
ln -s "$work/robot/orbbufd.crt" "$work/own/certificate"
ln -s "$work/robot/orbbufd.key" "$work/own/key"
ln -s "$work/robot/ca.crt" "$work/own/ca"
CREDENTIALS_DIRECTORY=$work/own "$robot" --config "$work/robot/orbbufd.toml" --set source.frames=9 --set source.loop=false --set source.realtime=false 2>"$work/robot.log" ||
  { cat "$work/robot.log" "$work/server.log" >&2 && bad=1; }
session=$(echo "$work"/frames/r1/*)
expect ' 9 ' "$server" check "$session"

# The doctors: nothing is wrong; then one thing at a time.
doctors=("$server doctor --config $work/etc/orbbuf-server.toml" "$robot doctor --config $work/robot/orbbufd.toml")
for doctor in "${doctors[@]}"; do
  read -ra command <<<"$doctor"
  expect 'nothing is wrong' "${command[@]}"
  touch "$work/machine/saves"
  refused 'wrong: power saving: wlan7' "${command[@]}"
  rm "$work/machine/saves"
  touch "$work/machine/clock"
  refused 'wrong: clock: no NTP client' "${command[@]}"
  rm "$work/machine/clock"
done
read -ra command <<<"${doctors[0]}"
touch "$work/machine/full"
refused 'wrong: disk: files.path' "${command[@]}"
rm "$work/machine/full"
chmod 644 "$work/etc/server.key"
refused 'wrong: permissions: other users have access to the key' "${command[@]}"
chmod 600 "$work/etc/server.key"
refused 'wrong: configuration: cannot read' "$server" doctor --config "$work/none.toml"
spoil() { # TEXT OLD NEW: with this change of the server's configuration
  sed "s|$2|$3|" "$work/etc/orbbuf-server.toml" >"$work/etc/spoiled.toml"
  refused "$1" "$server" doctor --config "$work/etc/spoiled.toml"
}
spoil 'wrong: configuration: ' '^\[listen\]' '[listen]\nno_such_key = 1'
spoil 'wrong: address: the server listens on 127.0.0.1' '0\.0\.0\.0:' '127.0.0.1:'
spoil 'wrong: address: this machine has no address 192.0.2.1' '0\.0\.0\.0:' '192.0.2.1:'
spoil 'wrong: address: no server listens at' '0\.0\.0\.0:.*' '0.0.0.0:1"'
spoil 'wrong: permissions: cannot read tls.ca' '^ca = .*' 'ca = "nowhere.crt"'
sed 's|^kind = .*|kind = "v4l2"|; s|^device = .*|device = "/dev/no-camera"|' "$work/robot/orbbufd.toml" >"$work/robot/spoiled.toml"
refused 'wrong: camera: no /dev/no-camera' "$robot" doctor --config "$work/robot/spoiled.toml"
[ $bad -eq 0 ] && echo 'scripts: passed'
exit $bad

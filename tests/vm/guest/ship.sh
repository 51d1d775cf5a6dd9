#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# What systemd runs in the virtual machine of tests/vm/ship.sh: before the power cut, and after it.
exec </dev/null >/dev/console 2>&1
export DEBIAN_FRONTEND=noninteractive LC_ALL=C
mkdir -p /run/ship
cd /run/ship || exit
# shellcheck source=tests/vm/guest/cases.sh
. /share/cases.sh
frames=/var/lib/private/orbbuf-server # which is the host's, so that no power cut takes of it
log=/run/ship/log                     # of what failed

value() { systemctl show -P "$2" "$1"; }
has() { # UNIT PROPERTY PATTERN
  # shellcheck disable=SC2254
  case $(value "$1" "$2") in $3) true ;; *) false ;; esac
}
at_least() { [ "$(value "$1" "$2")" -ge "$3" ]; }
priority_is() { [ "$(cut -d' ' -f19 "/proc/$(value "$1" MainPID)/stat")" -eq "$2" ]; } # UNIT NICE
is_active() { systemctl is-active -q "$@"; }
newest() { find "$frames/$1" -mindepth 1 -maxdepth 1 -printf '%f\n' 2>/dev/null | sort | tail -n 1; }
sessions() { find "$frames/$1" -mindepth 1 -maxdepth 1 2>/dev/null | wc -l; }
lines() { wc -l 2>/dev/null <"$frames/$1/$(newest "$1")/times.txt" || echo 0; }
has_lines() { [ "$(lines "$1")" -ge "$2" ]; }
goes_on() { # ROBOT: five more frames come
  local wanted=$(($(lines "$1") + 5))
  wait_for 40 has_lines "$1" $wanted
}
new_session() { [ "$(newest turtlebot1)" != "$1" ] && has_lines turtlebot1 5; }

say() { echo "  $(cut -d. -f1 /proc/uptime) s: $*"; }
ends() { # CASE: the verdict, with what systemd and the programs have to say
  systemctl --no-pager -l status orbbufd 'orbbufd@*' orbbuf-server >"$log" 2>&1
  journalctl --no-pager -o short-monotonic -n 60 -u orbbufd -u 'orbbufd@*' -u orbbuf-server >>"$log"
  verdict "$1"
  say
}

configure() { # FILE KEY=VALUE...: sets keys of a configuration
  local file=$1 setting
  shift
  for setting in "$@"; do
    grep -q "^${setting%%=*} = " "$file" || echo "no ${setting%%=*} in $file"
    sed -i -E "s|^(${setting%%=*} = \")[^\"]*|\1${setting#*=}|; s|^(${setting%%=*} = )[0-9][0-9.]*|\1${setting#*=}|" "$file"
  done
}

before() {
  say up
  find /etc /usr /var/lib -xdev | sort >/var/lib/ship-before
  apt-get install -q -y /share/orbbufd_*.deb /share/orbbuf-server_*.deb >apt.log 2>&1
  expect 'apt-get install' [ $? -eq 0 ]
  say installed
  cp apt.log "$log"
  for unit in orbbufd orbbuf-server; do
    expect "$unit is not running" has $unit ActiveState inactive
    expect "$unit is not enabled" [ "$(systemctl is-enabled $unit)" = disabled ]
  done
  expect 'the server starts as it is installed, without keys' systemctl start orbbuf-server
  expect 'and listens' has orbbuf-server StatusText 'listening on 127.0.0.1:7722; robots connected: 0'
  systemctl stop orbbuf-server
  cp /share/keys/{ca.crt,server.crt,server.key} /etc/orbbuf/
  cp /share/keys/turtlebot1.crt /etc/orbbuf/orbbufd.crt
  cp /share/keys/turtlebot1.key /etc/orbbuf/orbbufd.key
  chmod 600 /etc/orbbuf/*.key
  # Small and slow, since all of it is emulated; TLS takes its time, too.
  configure /etc/orbbuf/orbbufd.toml id=turtlebot1 fps=2 width=320 height=180 'connect_timeout=3 s' \
    certificate=credential:certificate key=credential:key ca=credential:ca
  # shellcheck disable=SC2016
  configure /etc/orbbuf/orbbuf-server.toml \
    certificate=credential:certificate key=credential:key ca=credential:ca \
    'command=echo priority $(nice); exec cat >/dev/null'
  cp /etc/orbbuf/orbbufd.toml kept.toml
  verdict 'ship: apt installs both packages, and nothing runs until it is started'

  systemctl enable -q orbbufd orbbuf-server
  systemctl start --no-block orbbufd
  expect 'started again and again' wait_for 60 at_least orbbufd NRestarts 2
  expect 'which is not given up' has orbbufd ActiveState activating
  say camera
  modprobe vivid n_devs=1 node_types=0x1 num_inputs=1 input_types=0x0
  expect 'captures when there is a camera' wait_for 60 is_active orbbufd
  expect 'says that there is no server' wait_for 20 has orbbufd StatusText '*link no connection: *refused*'
  say server
  systemctl start orbbuf-server
  expect 'ready when it listens' is_active orbbuf-server
  expect 'connects when there is a server' wait_for 20 has orbbufd StatusText '* link connected to *'
  expect 'the server says so' wait_for 20 has orbbuf-server StatusText '*robots connected: 1'
  expect 'frames' goes_on turtlebot1
  expect 'the priority of the robot' priority_is orbbufd -10
  expect 'of the server' priority_is orbbuf-server -10
  expect 'of the command of [slam]' logs orbbuf-server 'priority 0'
  ends 'ship: no camera and no server at boot: both come later, TLS keys are credentials'

  local session
  session=$(newest turtlebot1)
  expect 'kill -9 robot' kill -9 "$(value orbbufd MainPID)"
  expect 'a new session with frames' wait_for 60 new_session "$session"
  session=$(newest turtlebot1)
  expect 'kill -9 server' kill -9 "$(value orbbuf-server MainPID)"
  expect 'the session goes on' goes_on turtlebot1
  expect 'the same' [ "$(newest turtlebot1)" = "$session" ]
  ends 'ship: each killed by -9 is back, and the stream goes on'

  kill -STOP "$(value orbbufd MainPID)" "$(value orbbuf-server MainPID)"
  expect 'a new session with frames' wait_for 90 new_session "$session"
  expect 'the robot by its watchdog' logs orbbufd 'Watchdog timeout'
  expect 'the server by its watchdog' logs orbbuf-server 'Watchdog timeout'
  expect 'frames' goes_on turtlebot1
  ends 'ship: each that hangs is started again by its watchdog'

  session=$(newest turtlebot1)
  dpkg -i /share/newer/*.deb >dpkg.log 2>&1
  expect 'dpkg -i' [ $? -eq 0 ]
  say installed
  expect 'the new version' [ "$(dpkg-query -f '${Version}' -W orbbufd)" != "$(dpkg-deb -f /share/orbbufd_*.deb Version)" ]
  expect 'the configuration is kept' cmp /etc/orbbuf/orbbufd.toml kept.toml
  expect 'a new session with frames' wait_for 60 new_session "$session"
  expect 'the last one ended in peace' logs orbbufd 'session ended: captured'
  ends 'ship: an upgrade in mid-stream keeps configuration and stream'

  mkdir -p /etc/modules-load.d /etc/modprobe.d
  echo vivid >/etc/modules-load.d/vivid.conf
  echo 'options vivid n_devs=1 node_types=0x1 num_inputs=1 input_types=0x0' >/etc/modprobe.d/vivid.conf
  newest turtlebot1 >/var/lib/ship-session
  sync
  expect 'frames' goes_on turtlebot1
  save_log before
  echo b >/proc/sysrq-trigger
}

logs() { journalctl -o cat -u "$1" --no-pager | grep -q "$2"; }
save_log() { journalctl -b -o cat --no-pager -u orbbufd >"$frames/$1.log"; }

# large_images FOLDER: 20 JPEGs of 0.4 MB: one that came, with comments in it, so that they cost nothing to encode.
large_images() {
  local image
  image=$(find "$frames/turtlebot1/$(newest turtlebot1)/images" -name '*.jpg' | head -n 1)
  mkdir -p "$1"
  for _ in {1..20}; do
    head -c 2 "$image"
    for _ in {1..6}; do printf '\xff\xfe\xff\xff' && head -c 65533 /dev/zero; done
    tail -c +3 "$image"
  done >all.jpg
  split -n 20 -d --additional-suffix=.jpg all.jpg "$1/"
}

# mean_capture_rate UNIT: over the next 30 seconds, as it says each second: frames/s.
mean_capture_rate() {
  for _ in {1..30}; do
    sleep 1
    value "$1" StatusText
  done | awk '/frames\/s captured/ { sum += $1; n += 1 } END { printf "%.2f", n == 30 ? sum / n : 0 }'
}
has_segments() { find "$1" -name 'journal.*' -size +500k | grep -q .; }
disk_bytes() { awk '$3 == "vdb" { print $10 * 512 }' /proc/diskstats; }
between() { awk -v low="$1" -v value="$2" -v high="$3" 'BEGIN { exit !(low < value && value < high) }'; }
# per_second FROM TO START: since START seconds of uptime.
per_second() { awk -v from="$1" -v to="$2" -v start="$3" '{ printf "%.2f", (to - from) / ($1 - start) }' /proc/uptime; }
has_late() { grep -qs '^late [1-9]' "$frames/$1"/*/session.txt; }

# Frames of 2 MB/s for a spool on a disk that takes 1 MB/s, while there is no server.
slow_spool() {
  local state=/var/lib/private/orbbufd-slow config=/etc/orbbuf/orbbufd-slow.toml start bytes_before rate written
  cp /share/keys/slow.crt /etc/orbbuf/orbbufd-slow.crt
  cp /share/keys/slow.key /etc/orbbuf/orbbufd-slow.key
  cp /etc/orbbuf/orbbufd.toml $config
  large_images /run/ship/large
  configure $config id=slow kind=folder path=/run/ship/large fps=5 'memory=4 MiB' 'size=128 MiB' 'drain_timeout=0 s'
  sed -i -E -e 's/^loop = false/loop = true/' \
    -e '/^\[spool\]/,/^path/s|^(path = ")[^"]*|\1/var/lib/orbbufd-slow/spool|' $config
  mkdir -p $state
  mount /dev/vdb $state # systemd 257 refuses a mount in it
  systemctl stop orbbuf-server
  expect 'orbbufd@slow' systemctl start orbbufd@slow
  expect 'says that there is no server' wait_for 20 has orbbufd@slow StatusText '*link no connection: *refused*'
  expect 'a spool on the disk' wait_for 20 has_segments $state/spool
  start=$(cut -d' ' -f1 /proc/uptime) bytes_before=$(disk_bytes)
  rate=$(mean_capture_rate orbbufd@slow)
  written=$(per_second "$bytes_before" "$(disk_bytes)" "$start")
  say "captured $rate frames/s, while the disk took $written bytes/s"
  expect "captures $rate frames/s, not 5" between 4.75 "$rate" 5.25
  expect "the disk takes $written bytes/s, not 1 MB" between 500000 "$written" 1200000
  expect 'it stops' systemctl stop orbbufd@slow
  expect 'in peace' [ "$(value orbbufd@slow Result)" = success ]
  systemctl start orbbuf-server
  configure $config fps=1
  expect 'orbbufd@slow again' systemctl start orbbufd@slow
  expect 'late frames' wait_for 120 has_late slow
  ends 'ship: a robot with a spool on a disk of 1 MB/s captures at its rate'
  systemctl stop orbbufd@slow
  umount $state
}

after() {
  say up
  expect 'a new session with frames' wait_for 60 new_session "$(cat /var/lib/ship-session)"
  ends 'ship: after a power cut the stream comes back by itself'

  cp /share/keys/front.crt /etc/orbbuf/orbbufd-front.crt
  cp /share/keys/front.key /etc/orbbuf/orbbufd-front.key
  cp /etc/orbbuf/orbbufd.toml /etc/orbbuf/orbbufd-front.toml
  local camera=(kind=libcamera width=192 height=144)
  ! grep -qx 'VERSION_ID="13"' /etc/os-release || camera+=(format=RGB24) # as libcamera.sh has it
  configure /etc/orbbuf/orbbufd-front.toml id=front "${camera[@]}"
  modprobe vimc
  udevadm settle
  expect 'orbbufd@front' systemctl start orbbufd@front
  expect 'frames' goes_on front
  expect 'one robot more' wait_for 20 has orbbuf-server StatusText '*robots connected: 2'
  expect 'memory is counted' at_least orbbufd MemoryCurrent 1
  expect 'and it stops' systemctl stop orbbufd@front
  ends 'ship: a second camera, orbbufd@front, through libcamera'

  slow_spool

  local robot
  robot=$(value orbbufd MainPID)
  expect 'it runs' [ "$(readlink "/proc/$robot/exe")" = /usr/bin/orbbufd ]
  apt-get remove -q -y orbbufd >apt.log 2>&1
  expect 'apt-get remove' [ $? -eq 0 ]
  cp apt.log "$log"
  expect 'stopped' [ ! -e "/proc/$robot" ]
  expect 'the configuration stays' [ -e /etc/orbbuf/orbbufd.toml ]
  save_log after
  apt-get purge -q -y orbbufd orbbuf-server >apt.log 2>&1
  expect 'apt-get purge' [ $? -eq 0 ]
  rm -f /etc/orbbuf/*.{crt,key} /etc/orbbuf/orbbufd-{front,slow}.toml /etc/mod*.d/vivid.conf
  rmdir /etc/orbbuf 2>/dev/null
  find /etc /usr /var/lib -xdev | sort >after.txt
  comm -13 /var/lib/ship-before after.txt | grep -vE '^/var/lib/(ship-|(private/)?orbbuf|apt/|dpkg/|systemd/)' >left.txt
  cat left.txt >>"$log"
  expect 'nothing is left but data' [ ! -s left.txt ]
  verdict 'ship: removed and purged, nothing is left but data'
}

if [ -e /var/lib/ship-session ]; then
  after
  echo "DONE after $(cut -d' ' -f1 /proc/uptime) s"
  sync
  systemctl poweroff -ff
else
  before
fi

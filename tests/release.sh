#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A release of what ./dev package has built for this machine, signed with a throw-away key, made twice: the same bytes.
# Then the quick start of docs/quickstart.md, its own text, in a fresh Debian that boots systemd (systemd-nspawn): the
# packages come from the release's repository by apt, and frames are to arrive with TLS. The ports are the quick
# start's, on this machine's network. Usage: tests/release.sh; takes root
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
fail() { echo "release: $1" >&2 && exit 1; }
[ "$(id -u)" -eq 0 ] || fail 'this takes root'
for port in 7722 7723; do
  ! (: </dev/tcp/127.0.0.1/$port) 2>/dev/null || fail "port $port is in use"
done
mkdir -p build
work=$(mktemp -d "$PWD/build/release.XXXXXX")
trap 'rm -rf --one-file-system "$work"' EXIT
codename=${1-$(. /etc/os-release && echo "$VERSION_CODENAME")}

export GNUPGHOME=$work/gnupg
mkdir -m 700 "$GNUPGHOME"
gpg --batch --quiet --passphrase '' --faked-system-time 20200101T000000! \
  --quick-generate-key 'ORBBuf test <test@orbbuf.invalid>' ed25519 sign never 2>"$work/log" || fail "$(cat "$work/log")"
for which in one two; do toolchain/release.sh test@orbbuf.invalid file:///repository "$work/$which"; done
diff -r "$work/one" "$work/two" || fail 'a second release differs'
gpgconf --kill gpg-agent
echo 'RESULT door.release_reproducible 1'
(cd "$work/one" && sha256sum --quiet -c SHA256SUMS && gpg --verify SHA256SUMS.asc SHA256SUMS 2>"$work/log") || fail "$(cat "$work/log")"
python3 - "$work"/one/*.spdx.json <<'CHECK'
import json, sys
bom = json.load(open(sys.argv[1]))
names = {package["SPDXID"]: package["name"] for package in bom["packages"]}
edges = {(names.get(r["spdxElementId"]), r["relationshipType"], names[r["relatedSpdxElement"]]) for r in bom["relationships"]}
assert {("orbbufd", "DEPENDS_ON", "libc6"), ("orbbuf-server", "STATIC_LINK", "nlohmann-json3-dev")} <= edges, edges
CHECK

# A Debian with systemd, sudo, curl and a user.
root=$work/root
toolchain/root.sh make "$codename" "$root"
toolchain/root.sh run "$root" sh -ec 'apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -q -y \
  --no-install-recommends netbase systemd-sysv dbus sudo curl && useradd -m somebody &&
  echo "somebody ALL=(ALL) NOPASSWD: ALL" >/etc/sudoers.d/somebody && rm -rf /var/lib/apt/lists/*' >"$work/log" 2>&1 ||
  { tail "$work/log" >&2 && exit 1; }
awk '/^```/ { on = $0 == "```sh quickstart"; next } on' docs/quickstart.md |
  sed "s|REPOSITORY|file:///repository|; s|bookworm|$codename|" >"$root/home/somebody/quickstart.sh"
! grep -E '&&|;|[|]' "$root/home/somebody/quickstart.sh" || fail 'the quick start has two commands in a line'
cat >"$root/run.sh" <<'RUN'
#!/bin/bash
# In the guest. The time ends when the page shows a frame.
start=$EPOCHREALTIME
page() { curl -fsS --cacert /etc/orbbuf/ca.crt --cert-type P12 --cert /etc/orbbuf/viewer.p12: "https://localhost:7723$1"; }
su - somebody -c 'bash -ev quickstart.sh' || exit 1
until page /robots/robot1/image 2>/dev/null | head -c 3 | grep -q $'^\xff\xd8'; do [ $SECONDS -lt 500 ] || exit 1; done
awk -v from="$start" -v to="$EPOCHREALTIME" 'BEGIN { printf "RESULT door.seconds %.0f\n", to - from }'
awk '$1 == "usage_usec" { printf "RESULT door.cpu_seconds %.0f\n", $2 / 1e6 }' /sys/fs/cgroup/cpu.stat # since it was booted
systemctl is-active orbbuf-server orbbufd || exit 1
! curl -fsSk https://localhost:7723/ 2>/dev/null || exit 1 # no page without a certificate
orbbuf-server doctor
orbbufd doctor
systemctl stop orbbufd
orbbuf-server check /var/lib/orbbuf-server/robot1/* || exit 1
echo passed
RUN
cat >"$root/etc/systemd/system/quickstart.service" <<'UNIT'
[Unit]
After=multi-user.target
[Service]
Type=oneshot
Environment=LANG=C.UTF-8
ExecStart=/bin/sh -c 'LC_ALL=C /bin/bash /run.sh >/output 2>&1; systemctl --no-block poweroff'
UNIT
mkdir -p "$root/etc/systemd/system/multi-user.target.wants"
ln -s ../quickstart.service "$root/etc/systemd/system/multi-user.target.wants/"
# Version 2 of control groups alone, and a /run of its own: this machine may have neither systemd nor that.
# shellcheck disable=SC2016
unshare --mount --propagation private --cgroup bash -ec '
  umount -R /sys/fs/cgroup && mount -t cgroup2 none /sys/fs/cgroup && mount -t tmpfs none /run
  exec timeout --foreground --kill-after=10 900 systemd-nspawn --quiet -D "$1/root" --boot --console=pipe --register=no --keep-unit -M orbbuf-quickstart \
    --bind-ro="$1/one/apt:/repository"' - "$work" </dev/null >"$work/log" 2>&1 || true
grep -avE '^(Get:|Setting up |Unpacking |Selecting |Preparing |  |.Reading|update-alt)' "$root/output" || { cat "$work/log" >&2 && exit 1; }
[ "$(tail -n 1 "$root/output")" = passed ] || fail 'the quick start fails'
commands=$(grep -c . "$root/home/somebody/quickstart.sh")
seconds=$(sed -n 's/^RESULT door.seconds //p' "$root/output")
echo "RESULT door.commands $commands"
[ "$commands" -le 8 ] || fail "the quick start has $commands commands, more than 8"
[ "$seconds" -le 180 ] || fail "the quick start took $seconds s, more than 180"

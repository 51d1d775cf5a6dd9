#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The OCI image of the server, of what ./dev package has built: made twice, run by podman with a read-only root, without
# capabilities, with its keys as secrets. The image's own add-robot makes them. A robot streams with TLS; the server is
# killed and started again; no frame is lost. Usage: tests/image.sh; takes root
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
fail() { echo "image: $1" >&2 && exit 1; }
if [ "${1-}" != inside ]; then
  [ "$(id -u)" -eq 0 ] || fail 'this takes root'
  work=$(mktemp -d /tmp/orbbuf-image.XXXXXX) # podman refuses long paths
  trap 'rm -rf --one-file-system "$work"' EXIT
  suffix=~deb$(. /etc/os-release && echo "$VERSION_ID")u1_$(dpkg --print-architecture).deb
  for program in orbbufd orbbuf-server; do
    deb=$(compgen -G "build/packages/${program}_*$suffix" | tail -n 1) || fail "no build/packages/${program}_*$suffix: ./dev package makes it"
    dpkg-deb -x "$deb" "$work/$program"
  done
  toolchain/image.sh "$deb" "$work/image.tar" | tee "$work/said"
  toolchain/image.sh "$deb" "$work/again.tar" >/dev/null
  cmp "$work/image.tar" "$work/again.tar" || fail 'a second image differs'
  mib=$(sed -nE 's/^image: .*: ([0-9]+) MiB, packed.*/\1/p' "$work/said")
  echo "RESULT door.image_mib $mib"
  [ "$mib" -le 120 ] || fail "the image has $mib MiB, more than 120"
  mkdir -p build/packages
  cp "$work/image.tar" "build/packages/$(basename "$deb" .deb).oci.tar"
  # A network of its own, and version 2 of control groups alone, which podman asks for.
  unshare --mount --propagation private --net --cgroup "$PWD/tests/image.sh" inside "$work"
  exit
fi

work=$2
ip link set lo up
umount -R /sys/fs/cgroup && mount -t cgroup2 none /sys/fs/cgroup
podman() { command podman --log-level fatal --root "$work/storage" --runroot "$work/run" --cgroup-manager cgroupfs --storage-driver vfs "$@"; }
options=(--cgroups disabled --network host --read-only --cap-drop all --security-opt no-new-privileges
  --ulimit "nofile=$(ulimit -Hn):$(ulimit -Hn)" --ulimit nproc=1000:1000) # podman would raise them, which takes a privilege
podman load --quiet --input "$work/image.tar" >"$work/loaded"
image=$(sed -nE 's/^Loaded image[^:]*: *//p' "$work/loaded")
[[ $image == *orbbuf-server:* ]] || fail "loaded: $(cat "$work/loaded")"

mkdir "$work/etc" "$work/frames" "$work/robot" "$work/credentials"
cp "$work/orbbuf-server/etc/orbbuf/orbbuf-server.toml" "$work/etc/"
chown -R 7722:7722 "$work/etc" "$work/frames"
podman run --rm "${options[@]}" --volume "$work/etc:/etc/orbbuf" "$image" add-robot robot1 --server localhost
for secret in certificate:server.crt key:server.key ca:ca.crt; do
  podman secret create "${secret%:*}" "$work/etc/${secret#*:}" >/dev/null
done
podman run --detach --name server "${options[@]}" --volume "$work/frames:/var/lib/orbbuf-server" \
  --secret certificate,uid=7722,mode=0400 --secret key,uid=7722,mode=0400 --secret ca,uid=7722,mode=0400 \
  --health-cmd 'orbbuf-server status /tmp/orbbuf-status' "$image" >/dev/null
trap 'podman logs server 2>&1 | tail -n 5 >&2; podman rm --force server >/dev/null' EXIT
is_healthy() { podman exec server orbbuf-server status /tmp/orbbuf-status >"$work/status" 2>&1; }
await() { # COMMAND...
  local give_up=$((SECONDS + 120))
  until "$@"; do [ $SECONDS -lt $give_up ] || fail "waited for $*"; done
}
await is_healthy
podman healthcheck run server || fail 'not healthy'

"$work/orbbufd/usr/bin/orbbufd" setup --folder "$work/robot" --camera generated --force "$work/etc/robots/robot1.tar" >/dev/null
ln -s "$work/robot/orbbufd.crt" "$work/credentials/certificate"
ln -s "$work/robot/orbbufd.key" "$work/credentials/key"
ln -s "$work/robot/ca.crt" "$work/credentials/ca"
CREDENTIALS_DIRECTORY=$work/credentials "$work/orbbufd/usr/bin/orbbufd" --config "$work/robot/orbbufd.toml" \
  --set source.frames=300 --set source.fps=10 --set source.width=320 --set source.height=240 --set link.live_again=10min \
  --set link.drain_timeout=2min >"$work/robot.log" 2>&1 &
robot=$!
await sh -c "ls $work/frames/robot1/*/images/000050.jpg 2>/dev/null | grep -q ." # in its midst
podman kill --signal KILL server >/dev/null
podman wait server >/dev/null
podman start server >/dev/null
wait "$robot" || { cat "$work/robot.log" >&2 && fail 'the robot could not deliver all'; }
"$work/orbbuf-server/usr/bin/orbbuf-server" check "$work"/frames/robot1/* | tee "$work/check"
grep -q 'OK: 300 captured: 300 live' "$work/check" || fail 'a frame is missing'
podman stop server >/dev/null
echo 'image: passed'

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The OCI image of the server, of what ./dev package has built: made twice, run by podman as root, and without root as a
# user with no rights. The root of the container is read-only, it has no capabilities, and its keys are secrets, which the
# image's own add-robot makes. A robot streams with TLS; the server is killed and started again; no frame is lost. And the image for
# arm64, if build/packages has the package: its server takes frames in the emulator. And what examples/*/compose.yaml name.
# Usage: tests/image.sh; takes root
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
fail() { echo "image: $1" >&2 && exit 1; }
if [ $# -eq 0 ]; then
  [ "$(id -u)" -eq 0 ] || fail 'this takes root'
  /usr/bin/python3 - <<'PYTHON' || fail 'examples: a compose.yaml is wrong'
import pathlib, yaml
for path in pathlib.Path("examples").glob("*/compose.yaml"):
    compose = yaml.safe_load(path.read_text())
    for name, service in compose["services"].items():
        build = service.get("build")
        assert build is None or (path.parent / build["context"] / build["dockerfile"]).is_file(), (path, name)
        assert build or service["image"], (path, name)
        assert set(service.get("secrets", [])) <= set(compose.get("secrets", {})), (path, name)
        volumes = {volume.split(":")[0] for volume in service.get("volumes", [])}
        assert {volume for volume in volumes if volume[0] != "."} <= set(compose["volumes"]), (path, name)
assert yaml.safe_load(pathlib.Path("examples/compose/prometheus.yml").read_text())["scrape_configs"]
PYTHON
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
  chmod 755 "$work"
  cp tests/image.sh "$work/test.sh" # where a user can read it
  for user in root orbbuf-image; do
    unshare --mount --propagation private --net --pid --fork --kill-child --mount-proc --cgroup \
      "$work/test.sh" inside "$work" "$user"
  done
  deb=$(compgen -G "build/packages/orbbuf-server_*${suffix%_*}_arm64.deb" | tail -n 1) || exit 0
  toolchain/image.sh "$deb" "$work/arm64.tar"
  cp "$work/arm64.tar" "build/packages/$(basename "$deb" .deb).oci.tar"
  unshare --net --pid --fork --kill-child "$work/test.sh" arm64 "$work"
  exit
fi

if [ "$1" = arm64 ]; then
  cd "$2"
  ip link set lo up
  mkdir arm64 tree
  tar -C arm64 -xf arm64.tar
  layer=$(find arm64/blobs -type f -size +1M)
  tar -C tree -xzf "$layer"
  cp "$(command -v qemu-aarch64-static)" tree/
  emulated() { chroot --userspec=7722:7722 tree /qemu-aarch64-static "$@"; }
  emulated /usr/bin/orbbuf-server --set listen.address=127.0.0.1:7722 --set files.path=/var/lib/orbbuf-server --set status.socket= 2>server.log &
  orbbufd/usr/bin/orbbufd --set robot.id=robot1 --set link.server=127.0.0.1:7722 --set source.frames=50 --set link.drain_timeout=2min 2>robot.log ||
    { cat server.log robot.log >&2 && fail 'arm64: the robot could not deliver all'; }
  emulated /bin/bash -c 'exec /qemu-aarch64-static /usr/bin/orbbuf-server check /var/lib/orbbuf-server/robot1/*' | tee check
  grep -q 'OK: 50 captured: 50 live' check || fail 'arm64: a frame is missing'
  echo 'image: passed for arm64'
  exit
fi

packages=$2
user=$3
work=$2/$3
if [ "$1" = inside ]; then # namespaces of their own, with version 2 of control groups alone, which podman asks for
  ip link set lo up
  umount -R /sys/fs/cgroup && mount -t cgroup2 none /sys/fs/cgroup
  mkdir "$work"
  if [ "$user" != root ]; then # for whom this machine has no name
    printf '%s\n' "$user:x:64022:64022::$work:/bin/sh" | cat /etc/passwd - >"$packages/passwd"
    printf '%s\n' "$user:x:64022:" | cat /etc/group - >"$packages/group"
    for file in subuid subgid; do echo "$user:300000:65536" >"$packages/$file"; done
    for file in passwd group subuid subgid; do mount --bind "$packages/$file" "/etc/$file"; done
    mknod -m 666 "$packages/tun" c 10 200
    mount --bind "$packages/tun" /dev/net/tun # as udev has it
    chown "$user:$user" "$work"
  fi
  exec runuser -u "$user" -- "$packages/test.sh" run "$packages" "$user"
fi

cd "$work"
export HOME=$work XDG_RUNTIME_DIR=$work/runtime
mkdir -m 700 "$XDG_RUNTIME_DIR"
podman() { command podman --log-level fatal --root "$work/storage" --runroot "$work/run" --cgroup-manager cgroupfs --storage-driver vfs "$@"; }
options=(--cgroups disabled --read-only --cap-drop all --security-opt no-new-privileges
  --ulimit "nofile=$(ulimit -Hn):$(ulimit -Hn)" --ulimit nproc=1000:1000) # podman would raise them, which takes a privilege
own() { "$@"; } # COMMAND...: with the users of the containers
if [ "$user" = root ]; then
  options+=(--network host)
else
  own() { podman unshare "$@"; }
  options+=(--publish 7722:7722)
fi
podman load --quiet --input "$packages/image.tar" >"$work/loaded"
image=$(sed -nE 's/^Loaded image[^:]*: *//p' "$work/loaded")
[[ $image == *orbbuf-server:* ]] || fail "loaded: $(cat "$work/loaded")"

mkdir etc robot credentials
cp "$packages/orbbuf-server/etc/orbbuf/orbbuf-server.toml" etc/
own chown -R 7722:7722 etc
podman run --rm "${options[@]}" --volume "$work/etc:/etc/orbbuf" "$image" add-robot robot1 --server localhost
for secret in certificate:server.crt key:server.key ca:ca.crt; do
  own cat "etc/${secret#*:}" | podman secret create "${secret%:*}" - >/dev/null
done
own cat etc/robots/robot1.tar >robot1.tar
podman run --detach --name server "${options[@]}" --volume frames:/var/lib/orbbuf-server \
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

"$packages/orbbufd/usr/bin/orbbufd" setup --folder "$work/robot" --camera generated --force robot1.tar >/dev/null
ln -s "$work/robot/orbbufd.crt" "$work/credentials/certificate"
ln -s "$work/robot/orbbufd.key" "$work/credentials/key"
ln -s "$work/robot/ca.crt" "$work/credentials/ca"
CREDENTIALS_DIRECTORY=$work/credentials "$packages/orbbufd/usr/bin/orbbufd" --config "$work/robot/orbbufd.toml" \
  --set source.frames=300 --set source.loop=false --set source.fps=10 --set source.width=320 --set source.height=240 --set link.live_again=10min \
  --set link.drain_timeout=2min >"$work/robot.log" 2>&1 &
robot=$!
frames=$(podman volume inspect --format '{{.Mountpoint}}' frames)
await own sh -c "ls $frames/robot1/*/images/000050.jpg 2>/dev/null | grep -q ." # in its midst
podman kill --signal KILL server >/dev/null
podman wait server >/dev/null
podman start server >/dev/null
wait "$robot" || { cat "$work/robot.log" >&2 && fail 'the robot could not deliver all'; }
podman stop server >/dev/null
podman run --rm "${options[@]}" --volume frames:/var/lib/orbbuf-server --entrypoint sh "$image" \
  -c 'orbbuf-server check /var/lib/orbbuf-server/robot1/*' | tee "$work/check"
grep -q 'OK: 300 captured: 300 live' "$work/check" || fail 'a frame is missing'
echo "image: passed as $user"

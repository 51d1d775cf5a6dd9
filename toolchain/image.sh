#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes an OCI image of the server of one layer: DEB, a package of orbbuf-server for this Debian release, what it depends
# on, and the tools of its scripts, unpacked by mmdebstrap; no maintainer script runs, so it need not be this machine's
# processor. The same packages give the same bytes. docs/image.md says how to run it.
# Usage: toolchain/image.sh DEB IMAGE.tar; takes root
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source=toolchain/sources.sh
. "$here/sources.sh"
deb=$(realpath "$1")
image=$(realpath "$2")
architecture=$(dpkg-deb -f "$deb" Architecture)
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git -C "$here" log -1 --format=%ct 2>/dev/null || stat -c %Y "$here/../CHANGELOG.md")}
export SOURCE_DATE_EPOCH
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
chmod 755 "$work"
mkdir "$work/repository"
cp "$deb" "$work/repository/"
(cd "$work/repository" && dpkg-scanpackages --multiversion . >Packages 2>/dev/null)
lines=$(debian_sources "$(own_release)")
mapfile -t sources <<<"$lines"
mmdebstrap --quiet --mode=root --variant=extract --architectures="$architecture" --hook-dir=/usr/share/mmdebstrap/hooks/merged-usr \
  --include=orbbuf-server,bash,coreutils,dash,grep,hostname,mawk,sed,tar \
  --dpkgopt='path-exclude=/usr/share/*' --dpkgopt='path-exclude=/usr/lib/*/gconv/*' --dpkgopt='path-exclude=/usr/lib/*/perl*' \
  --aptopt='APT::Install-Recommends "false"' \
  "$(own_release)" "$work/root" "${sources[@]}" "deb [trusted=yes] copy:$work/repository ./" >"$work/log" 2>&1 || { tail "$work/log" >&2 && exit 1; }
(
  cd "$work/root" # mmdebstrap runs no hooks on what is only unpacked
  rm -rf usr/share/* usr/lib/*/gconv usr/lib/*/perl* usr/bin/perl* etc/apt var/lib/apt var/lib/dpkg var/cache/* var/log/* dev/*
  ln -sf mawk usr/bin/awk
  mkdir -p -m 1777 tmp
  mkdir -p var/lib/orbbuf-server
  chown 7722:7722 var/lib/orbbuf-server
  tar --sort=name --mtime="@$SOURCE_DATE_EPOCH" --clamp-mtime --numeric-owner -cf "$work/layer.tar" .
)

/usr/bin/python3 - "$work" "$architecture" "$(dpkg-deb -f "$deb" Version)" <<'PYTHON'
import datetime, gzip, hashlib, json, os, pathlib, sys
work, architecture, version = pathlib.Path(sys.argv[1]), sys.argv[2], sys.argv[3]
out = work / "image"
(out / "blobs/sha256").mkdir(parents=True)
created = datetime.datetime.fromtimestamp(int(os.environ["SOURCE_DATE_EPOCH"]), datetime.timezone.utc).isoformat()

def blob(data, kind, **more):
    digest = hashlib.sha256(data).hexdigest()
    (out / "blobs/sha256" / digest).write_bytes(data)
    return {"mediaType": f"application/vnd.oci.image.{kind}", "digest": f"sha256:{digest}", "size": len(data), **more}

layer = (work / "layer.tar").read_bytes()
settings = ("listen.address=0.0.0.0:7722", "http.address=0.0.0.0:7723", "status.socket=/tmp/orbbuf-status",
            "tls.certificate=credential:certificate", "tls.key=credential:key", "tls.ca=credential:ca")
config = blob(json.dumps({
    "created": created, "architecture": {"armhf": "arm"}.get(architecture, architecture), "os": "linux",
    "config": {"User": "7722:7722", "ExposedPorts": {"7722/tcp": {}, "7723/tcp": {}},
               "Env": ["PATH=/usr/bin:/bin", "CREDENTIALS_DIRECTORY=/run/secrets"],
               "Entrypoint": ["/usr/bin/orbbuf-server"],
               "Cmd": ["--config", "/etc/orbbuf/orbbuf-server.toml"] + [word for key in settings for word in ("--set", key)],
               "Volumes": {"/var/lib/orbbuf-server": {}}, "StopSignal": "SIGTERM",
               "Labels": {"org.opencontainers.image.version": version, "org.opencontainers.image.licenses": "Apache-2.0"}},
    "rootfs": {"type": "layers", "diff_ids": ["sha256:" + hashlib.sha256(layer).hexdigest()]},
    "history": [{"created": created, "created_by": "toolchain/image.sh"}]}).encode(), "config.v1+json")
manifest = blob(json.dumps({"schemaVersion": 2, "mediaType": "application/vnd.oci.image.manifest.v1+json", "config": config,
                            "layers": [blob(gzip.compress(layer, 9, mtime=0), "layer.v1.tar+gzip")]}).encode(), "manifest.v1+json",
                annotations={"org.opencontainers.image.ref.name": f"orbbuf-server:{version.split('-')[0]}"})
(out / "index.json").write_text(json.dumps({"schemaVersion": 2, "manifests": [manifest]}))
(out / "oci-layout").write_text('{"imageLayoutVersion": "1.0.0"}')
PYTHON
tar -C "$work/image" --sort=name --mtime="@$SOURCE_DATE_EPOCH" --owner=0 --group=0 --numeric-owner -cf "$image" .
echo "image: $image: $(($(stat -c %s "$work/layer.tar") >> 20)) MiB, packed $(($(stat -c %s "$image") >> 20)) MiB"

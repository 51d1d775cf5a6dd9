#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes a release of this commit in FOLDER, which is made again, of what ./dev package and ./dev test-python left in
# build/packages: the packages in an apt repository of static files, the Python wheel, the images of the server, a source tarball, an SBOM
# (SPDX), and SHA256SUMS. KEY signs: as gpg --local-user names it. URL: where FOLDER/apt will be; apt reads it from
# FOLDER/apt/orbbuf-CODENAME.sources. The same commit, packages and key give the same bytes.
# Usage: toolchain/release.sh KEY URL FOLDER
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
key=$1 url=$2 folder=$3
umask 022
fail() { echo "release: $1" >&2 && exit 1; }

version=$(sed -nE 's/^project\(orbbuf VERSION ([0-9.]+).*/\1/p' CMakeLists.txt)
date=$(sed -nE "s/^## $version \(([0-9-]+)\)\$/\1/p" CHANGELOG.md)
[ "$(grep -m 1 '^## ' CHANGELOG.md)" = "## $version ($date)" ] ||
  fail "CHANGELOG.md does not begin with \"## $version (DATE)\""
[ -z "$(git status --porcelain --untracked-files=no)" ] || fail 'the tree has changes that are not committed'
tag=$(git tag --points-at HEAD 'v*')
[ -z "$tag" ] || [ "$tag" = "v$version" ] || fail "the tag is $tag, but the version is $version"
epoch=$(git log -1 --format=%ct)
sign() {
  local said
  said=$(gpg --batch --yes --local-user "$key" --faked-system-time "${epoch}!" --digest-algo SHA512 "$@" 2>&1) || fail "$said"
}

rm -rf "$folder"
mkdir -p "$folder/apt"
folder=$(cd "$folder" && pwd)
git archive --prefix="orbbuf-$version/" HEAD | gzip -9n >"$folder/orbbuf-$version.tar.gz"
cp build/packages/orbbuf-"$version"-*.whl "$folder/" 2>/dev/null || echo 'release: no wheel: ./dev test-python makes it'

mapfile -t images < <(compgen -G "build/packages/orbbuf-server_$version-1~*.oci.tar")
[ ${#images[@]} -eq 0 ] || cp "${images[@]}" "$folder/"
[ ${#images[@]} -gt 0 ] || echo 'release: no image: ./dev test-image makes it'

# repository CODENAME SUFFIX: of the packages whose version ends with the suffix.
repository() (
  local debs architectures architecture file
  mapfile -t debs < <(compgen -G "build/packages/*_$version-1~$2_*.deb")
  [ ${#debs[@]} -gt 0 ] || { echo "release: no packages for $1" && exit; }
  mkdir -p "$folder/apt/pool/$1" "$folder/apt/dists/$1/main"
  cp "${debs[@]}" "$folder/apt/pool/$1/"
  cd "$folder/apt"
  architectures=$(printf '%s\n' pool/"$1"/*.deb | sed -nE 's/.*_(.*)\.deb/\1/p' | grep -vx all | sort -u)
  for architecture in $architectures; do
    mkdir "dists/$1/main/binary-$architecture"
    dpkg-scanpackages --multiversion --arch "$architecture" "pool/$1" >"dists/$1/main/binary-$architecture/Packages" 2>/dev/null
    gzip -9nk "dists/$1/main/binary-$architecture/Packages"
  done
  cd "dists/$1"
  {
    printf '%s\n' 'Origin: ORBBuf' 'Label: ORBBuf' "Codename: $1" "Suite: $1" "Version: $version" \
      "Date: $(LC_ALL=C date -u -R -d "@$epoch")" "Architectures: ${architectures//$'\n'/ }" 'Components: main' 'SHA256:'
    find main -type f | sort | while read -r file; do
      echo " $(sha256sum <"$file" | cut -d ' ' -f 1) $(stat -c %s "$file") $file"
    done
  } >Release
  sign --clearsign --output InRelease Release
  sign --armor --detach-sign --output Release.gpg Release
  cd ../..
  {
    printf '%s\n' 'Types: deb' "URIs: $url" "Suites: $1" 'Components: main' 'Signed-By:'
    gpg --batch --armor --export "$key" | sed 's/^$/./; s/^/ /'
  } >"orbbuf-$1.sources"
)
repository bookworm deb12u1
repository trixie deb13u1
compgen -G "$folder/apt/pool/*/*.deb" >/dev/null || fail "no packages of $version in build/packages: ./dev package makes them"

/usr/bin/python3 toolchain/sbom.py "$version" "$epoch" "$folder/apt/pool" >"$folder/orbbuf-$version.spdx.json"
(cd "$folder" && find . -type f ! -name 'SHA256SUMS*' -printf '%P\n' | LC_ALL=C sort | xargs sha256sum >"$folder/SHA256SUMS")
sign --armor --detach-sign --output "$folder/SHA256SUMS.asc" "$folder/SHA256SUMS"
echo "release: $folder: $(wc -l <"$folder/SHA256SUMS") files"

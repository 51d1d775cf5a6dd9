#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# bench/dds/sources.sh with a V4L2 camera, the kernel's vivid, in a virtual machine. Usage: bench/dds/vm.sh BUILD_FOLDER
# [--cuts N]
set -euo pipefail
build=$(cd "$1" && pwd)
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
vm=$build/../vm-dds
programs=("$build"/{daemon/orbbufd,server/orbbuf-server,bench/orbbuf-dds-timed-reader,bench/orbbuf-dds-topic-writer})

export VM_PACKAGES=coreutils,iproute2,libc-bin,mawk,nftables VM_MODULES='veth nf_tables'
"$here/../../tests/vm/image.sh" "$vm" "${programs[@]}"
rm -rf "$vm/share"
mkdir "$vm/share"
cp "${programs[@]}" "$here"/{guest,parts,sources}.sh "$here/../../tests/vm/guest/setup.sh" "$vm/share/"
echo "${@:2}" >"$vm/share/options"
"$here/../../tests/vm/boot.sh" "$vm" "$vm/share" | tee "$vm/console.log" | grep --line-buffered '^RESULT' || true
if grep -q '^DONE' "$vm/console.log"; then exit 0; fi
echo "bench sources: failed; see $vm/console.log" >&2
exit 1

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What capturing and JPEG cost a frame, for orbbufd, ustreamer and GStreamer: the same camera (the
# kernel's vivid, YUYV, quality 80) in the same virtual machine, one after the other; and for orbbufd in
# colour.
# Usage: bench/capture/run.sh BUILD_FOLDER
set -euo pipefail
build=$(cd "$1" && pwd)
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
vm=$build/../vm-capture
programs=("$build/daemon/orbbufd" "$build/server/orbbuf-server")

export VM_PACKAGES=ustreamer,gstreamer1.0-tools,gstreamer1.0-plugins-base,gstreamer1.0-plugins-good
"$here/../../tests/vm/image.sh" "$vm" "${programs[@]}"
rm -rf "$vm/share"
mkdir "$vm/share"
cp "${programs[@]}" "$here/guest.sh" "$here/../../tests/vm/guest/setup.sh" "$vm/share/"
"$here/../../tests/vm/boot.sh" "$vm" "$vm/share" | tee "$vm/console.log" |
  grep --line-buffered -E '^(capture|RESULT|FAIL)' || true
if grep -q '^DONE' "$vm/console.log" && ! grep -q '^FAIL' "$vm/console.log"; then exit 0; fi
echo "bench capture: failed; see $vm/console.log" >&2
exit 1

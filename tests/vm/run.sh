#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Captures with the kernel's own simulated cameras in a virtual machine: vivid, vimc through libcamera,
# and a USB camera that is played by a program. One line for each case, PASS or FAIL; what the guest
# printed, with the logs of what failed, is in BUILD/vm/console.log. Usage: tests/vm/run.sh BUILD
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=$(cd "$1" && pwd)
vm=$build/../vm
programs=("$build"/daemon/orbbufd "$build"/server/orbbuf-server "$build"/tests/vm/orbbuf-usb-camera)

"$here/image.sh" "$vm" "${programs[@]}"
rm -rf "$vm/share"
mkdir "$vm/share"
cp "${programs[@]}" "$build/tests/vm/orbbuf-usb-firmware-path.so" "$here"/guest/*.sh "$vm/share/"
"$here/boot.sh" "$vm" "$vm/share" | tee "$vm/console.log" |
  grep --line-buffered -E '^(PASS|FAIL|RESULT|DONE) ' || true

if grep -q '^DONE ' "$vm/console.log" && ! grep -q '^FAIL ' "$vm/console.log"; then exit 0; fi
echo "test-vm: failed; see $vm/console.log" >&2
exit 1

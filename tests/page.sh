#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The live page in a real browser, headless: a robot streams through an outage. What is asserted is in
# page/page_test.mjs; pictures are left in build/page. And Foxglove's client, in page/foxglove_test.mjs. Usage: tests/page.sh BUILD_FOLDER
# Exit status 77: it cannot run here.
set -euo pipefail
build=$(realpath "$1")
tests=$(dirname "$(realpath "${BASH_SOURCE[0]}")")
out=$tests/../build/page
for program in node npm chromium; do
  command -v "$program" >/dev/null || { echo "page.sh: skipped: no $program here" && exit 77; }
done
mkdir -p "$out"
out=$(realpath "$out")
# Drives the Chromium that is there; downloads none.
[ -d "$out/node_modules/@foxglove/ws-protocol" ] ||
  npm install --silent --no-audit --no-fund --prefix "$out" playwright-core@1 @foxglove/ws-protocol@0.8 ws@8 ||
  { echo 'page.sh: skipped: no npm registry' && exit 77; }
cp "$tests"/page/*.mjs "$out/"
node "$out/foxglove_test.mjs" "$build/daemon/orbbufd" "$build/server/orbbuf-server"
exec node "$out/page_test.mjs" "$build/daemon/orbbufd" "$build/server/orbbuf-server" "$out"

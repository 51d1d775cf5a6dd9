#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The README's commands on a bare Debian: an essential system, in a folder that is removed again, and a clone of HEAD.
# First as a user with sudo, who installs what is needed; then as root, in a root of its own, from nothing; then root's
# build is tested by a user. A test that skips for a reason not in EXPECTED fails.
# Usage: tests/bare.sh RELEASE; takes root
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
release=$1
# What a skipped test prints, as regular expressions: where it runs as root, and what else where a user runs it.
EXPECTED=(
  'shared/data/sequences'                   # recorded sequences, which are not in the repository
  'Linux has TCP_RTO_MAX_MS since 6\.15'    # an older kernel
  'mcap: skipped: no '                      # node and its packages
  'units: no systemd-analyze'               # the package systemd, which nothing else needs
)
EXPECTED_OF_A_USER=('not root' 'Operation not permitted' 'ptrace is not permitted')

mkdir -p build
work=$(mktemp -d "$PWD/build/bare.XXXXXX")
running=
clean() {
  [ -z "$running" ] || kill -KILL "$running" 2>/dev/null || true # and with it all that it started
  rm -rf --one-file-system "$work"
}
trap clean EXIT
trap 'exit 130' INT TERM HUP

# inside ROOT COMMAND: by root's shell, in root's clone; ends with this script.
inside() {
  toolchain/root.sh run "$work/$1" bash -c "cd /root/orbbuf && $2" </dev/null &
  running=$!
  wait "$running" || { local status=$? && running='' && return $status; }
  running=
}

# timed NAME ROOT COMMAND
timed() {
  local start=$SECONDS
  inside "$2" "$3"
  echo "RESULT bare.$release.$1 $((SECONDS - start))"
}

# skips NAME LOG REASON...: counts the tests that ctest's LOG has as skipped; fails if one names no expected REASON.
skips() {
  local name=$1 log=$2 reasons
  shift 2
  reasons=$(IFS='|' && echo "$*")
  REASONS=$reasons awk -v name="bare.$name" '
    /^[0-9]+\/[0-9]+ Test: / { test = $3; text = "" }
    { text = text $0 "\n" }
    /^Test Skipped\.$/ {
      skipped++
      if (text !~ ENVIRON["REASONS"]) { unexpected = 1; print "bare: unexpected skip: " text }
      else print "skipped, as expected: " test
    }
    END { print "RESULT " name " " skipped + 0; exit unexpected }' "$log"
}

toolchain/root.sh make "$release" "$work/bare"
git clone -q --no-hardlinks . "$work/bare/root/orbbuf"

cp -a "$work/bare" "$work/user"
USER_DEPS='apt-get update -q && apt-get install -q -y --no-install-recommends sudo && useradd -m somebody &&
  echo "somebody ALL=(ALL) NOPASSWD: ALL" >/etc/sudoers.d/somebody && cp -r . /home/somebody/orbbuf &&
  chown -R somebody: /home/somebody && cd /home/somebody/orbbuf && su somebody -c "./dev deps && ./dev deps >again && ! test -s again"'
timed user_deps_s user "$USER_DEPS"
rm -rf --one-file-system "$work/user"

timed demo_s bare './dev demo'
timed test_s bare './dev test'
skips "$release.skipped" "$work/bare/root/orbbuf/build/dev/Testing/Temporary/LastTest.log" "${EXPECTED[@]}"

# The same programs and tests, by a user without sudo: nothing is left to install or to compile.
timed user_test_s bare 'useradd -m somebody && chown -R somebody: /root && chmod 755 /root && su somebody -c "./dev test"'
skips "$release.user_skipped" "$work/bare/root/orbbuf/build/dev/Testing/Temporary/LastTest.log" \
  "${EXPECTED[@]}" "${EXPECTED_OF_A_USER[@]}"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The README's commands on a bare Debian: an essential system, in a folder that is removed again, and a clone of HEAD.
# First each program alone, as a user with sudo, who installs what is needed; then as root, in a root of its own, from
# nothing; then root's build is tested by a user. A test that skips for a reason not in EXPECTED fails.
# Usage: tests/bare.sh RELEASE; takes root
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
release=$1
# What a skipped test prints, as regular expressions: where it runs as root, and what else where a user runs it.
EXPECTED=(
  'shared/data/sequences'                   # recorded sequences, which are not in the repository
  'Linux has TCP_RTO_MAX_MS since 6\.15'    # an older kernel
  'mcap: skipped: no '                      # node and its packages
  'no names of multicast DNS here'          # avahi-daemon, which a root without services cannot run
  'units: no systemd-analyze'               # the package systemd, which nothing else needs
  'defects: no git checkout, or no git'     # the package git, which nothing else needs
  'TCP.s window was never full'             # a machine so slow that the sender waits for acknowledgements before
)
EXPECTED_OF_A_USER=('not root' 'Operation not permitted' 'ptrace is not permitted' 'this user cannot mount')

mkdir -p build
work=$(mktemp -d "$PWD/build/bare.XXXXXX")
running=
clean() {
  [ -z "$running" ] || kill -KILL "$running" 2>/dev/null || true # and with it all that it started
  rm -rf --one-file-system "$work"
}
trap clean EXIT
trap 'exit 130' INT TERM HUP

# inside ROOT COMMAND: by root's shell, in root's clone; ends with this script. The output is kept in /output, too.
inside() {
  toolchain/root.sh run "$work/$1" bash -c "set -o pipefail; { cd /root/orbbuf && $2; } | tee /output" </dev/null &
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

# skips NAME OUTPUT LOG REASON...: counts the tests that ctest's OUTPUT lists as skipped; fails if one of them names no
# expected REASON in ctest's LOG.
skips() {
  local name=$1 output=$2 log=$3 reasons
  shift 3
  reasons=$(IFS='|' && echo "$*")
  REASONS=$reasons awk -v name="bare.$name" '
    FNR == NR {
      if (!/^\t *[0-9]+ - .* \(Skipped\)$/) next
      sub(/^\t *[0-9]+ - /, ""); sub(/ \(Skipped\)$/, "")
      skipped[$0] = 1; count++
      next
    }
    sub(/^[0-9]+\/[0-9]+ Test: /, "") { test = $0 }
    test in skipped { text[test] = text[test] $0 "\n" }
    END {
      for (test in skipped) {
        if (text[test] ~ ENVIRON["REASONS"]) print "skipped, as expected: " test
        else { unexpected = 1; print "bare: unexpected skip: " test "\n" text[test] }
      }
      print "RESULT " name " " count + 0
      exit unexpected
    }' "$output" "$log"
}

toolchain/root.sh make "$release" "$work/bare"
git clone -q --no-hardlinks . "$work/bare/root/orbbuf"

# as_user COMMAND: in a new root, by a user with sudo, in a clone of his own.
as_user() {
  rm -rf --one-file-system "$work/user"
  cp -a "$work/bare" "$work/user"
  inside user 'apt-get update -q && apt-get install -q -y --no-install-recommends sudo && useradd -m somebody &&
    echo "somebody ALL=(ALL) NOPASSWD: ALL" >/etc/sudoers.d/somebody && cp -r . /home/somebody/orbbuf &&
    chown -R somebody: /home/somebody && dpkg-query -W >/before'
  inside user "cd /home/somebody/orbbuf && su somebody -c '$1' && dpkg-query -W >/after"
}

# packages NAME: how many as_user has installed.
packages() {
  echo "RESULT bare.$release.$1 $(($(wc -l <"$work/user/after") - $(wc -l <"$work/user/before")))"
}

# Its own packages suffice, no other program's.
for program in robot/daemon/orbbufd server/server/orbbuf-server; do
  start=$SECONDS
  as_user "./dev build ${program%%/*} && build/$program --version"
  echo "RESULT bare.$release.${program%%/*}_s $((SECONDS - start))"
  packages "${program%%/*}_packages"
done
as_user './dev deps && ./dev deps >again && ! test -s again'
packages packages
rm -rf --one-file-system "$work/user"

timed demo_s bare './dev demo'
timed test_s bare './dev test'
skips "$release.skipped" "$work/bare/output" "$work/bare/root/orbbuf/build/dev/Testing/Temporary/LastTest.log" "${EXPECTED[@]}"

# The same programs and tests, by a user without sudo: nothing is left to install or to compile.
timed user_test_s bare 'useradd -m somebody && chown -R somebody: /root && chmod 755 /root && su somebody -c "./dev test"'
skips "$release.user_skipped" "$work/bare/output" "$work/bare/root/orbbuf/build/dev/Testing/Temporary/LastTest.log" \
  "${EXPECTED[@]}" "${EXPECTED_OF_A_USER[@]}"

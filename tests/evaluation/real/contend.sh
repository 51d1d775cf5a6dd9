#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Of contenders that run at once, one that fails is named, a peer that is not installed is not, and all are
# waited for. A stand-in for flow.sh ends as its contender's name says.
set -euo pipefail
real=$(cd "$(dirname "${BASH_SOURCE[0]}")/../../../evaluation/real" && pwd)
work=$(mktemp -d "${TMPDIR:-/tmp}/orbbuf-real.XXXXXX")
trap 'rm -rf "$work"' EXIT
# shellcheck disable=SC2034 # for contend.sh
here=$work build='' out=$work/out mbit=16 seed=1
mkdir "$work/real"
ln -s "$real/summary.sh" "$work/real"
cat >"$work/real/flow.sh" <<'FLOW'
#!/usr/bin/env bash
mkdir -p "$3"
case $4 in failing) exit 3 ;; absent*) exit 77 ;; esac
echo '2 0.100 never 0.900 never 0.500 2048 90' >"$3/summary"
FLOW
chmod +x "$work/real/flow.sh"
printf '000000 0.1\n000001 0.2\n' >"$work/times.txt"
say() { :; }
# shellcheck disable=SC2034
PEERS=(absent plain)
# shellcheck source=evaluation/real/contend.sh
. "$real/contend.sh"
contend cuts 7 "$work" cut 25 2 6 7 failing absent orbbuf plain absent-own
[ "${failed[*]}" = 'cuts/failing@7 cuts/absent-own@7' ]
[ "$(peer_table cuts | tail -n +3)" = '| orbbuf@7 | 2 | 0.10, never | 0.90, never | 0.50 | 2 | 90 |
| plain@7 | 2 | 0.10, never | 0.90, never | 0.50 | 2 | 90 |' ]

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Whether each patch of testing/simulation/defects still applies to this tree, and stands in the README there.
# Usage: tests/defects.sh
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
{ [ -e .git ] && command -v git >/dev/null; } || { echo 'defects: no git checkout, or no git' && exit 77; }
defects=testing/simulation/defects
bad=0
diff <(basename -s .patch -a $defects/*.patch | sort) <(sed -n 's/^\([a-z_]\{1,\}\)$/\1/p' $defects/README | sort) >&2 ||
  { echo 'defects: the patches (<) are not those of the README (>)' >&2 && bad=1; }
for patch in "$defects"/*.patch; do
  git apply --check "$patch" || { echo "defects: $patch does not apply: write it anew for today's code" >&2 && bad=1; }
done
exit $bad

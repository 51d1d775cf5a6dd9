#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The Python package: its types, its tests, and a wheel, built twice and offline, that works by itself.
# Usage: tests/python/run.sh BUILD_FOLDER
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
ORBBUF_BUILD=$(realpath "$1")
export ORBBUF_BUILD PYTHONDONTWRITEBYTECODE=1
python=/usr/bin/python3 # Debian's
(cd python && $python -m mypy --cache-dir=/dev/null orbbuf)
PYTHONPATH=$PWD/python $python -m unittest discover tests/python

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
for which in one two; do
  $python -m build --wheel --no-isolation --skip-dependency-check --outdir "$folder/$which" python >"$folder/log" 2>&1 || { cat "$folder/log" && exit 1; }
done
cmp "$folder"/one/*.whl "$folder"/two/*.whl
version=$(sed -nE 's/^project\(orbbuf VERSION ([0-9.]+).*/\1/p' CMakeLists.txt)
[ -e "$folder/one/orbbuf-$version-py3-none-any.whl" ] || { ls "$folder/one" && exit 1; }
mkdir -p build/packages "$folder/site"
$python -m zipfile -e "$folder"/one/*.whl "$folder/site"
[ -e "$folder/site/orbbuf/py.typed" ]
(cd / && PYTHONPATH=$folder/site $python -m orbbuf --help >/dev/null)
cp "$folder"/one/*.whl build/packages/
echo "python: build/packages/orbbuf-$version-py3-none-any.whl"

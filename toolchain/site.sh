#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes the site of the Markdown pages in FOLDER, with search, without anything of other hosts. Fails if a link leads
# nowhere. Usage: toolchain/site.sh FOLDER
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
folder=$(realpath "$1")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# The pages where they are, so that their links hold, and what they link to.
mkdir "$work/pages"
git ls-files '*.md' 'docs/*.svg' ':!.github' | while read -r page; do
  echo "$page"
  grep -oE '\]\([^)#:]+' "$page" | cut -c3- | while read -r target; do
    file=$(realpath -m --relative-to=. "$(dirname "$page")/$target")
    [ ! -f "$file" ] || echo "$file"
  done || true
done | sort -u | xargs cp --parents -t "$work/pages"
# As mkdocs wants them: fences of one word, and four spaces before what belongs to an item of a numbered list.
find "$work/pages" -name '*.md' -exec sed -i -E 's/^( *```[a-z]+) .*/\1/; s/^   ([^ ])/    \1/' {} +
cp toolchain/site.yml "$work/mkdocs.yml"
version=$(sed -nE 's/^project\(orbbuf VERSION ([0-9.]+).*/\1/p' CMakeLists.txt)
sed -i "s/VERSION/$version/" "$work/mkdocs.yml"
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct 2>/dev/null || stat -c %Y CHANGELOG.md) \
  mkdocs build --quiet --strict --config-file "$work/mkdocs.yml" --site-dir "$folder"
if grep -rlE '(src|href)="https?://[^"]*\.(js|css|woff2?)"' "$folder" --include='*.html' | head -n 1 | grep .; then
  echo 'site: a page loads something of another host' >&2 && exit 1
fi
echo "site: $folder/index.html: $(find "$folder" -name '*.html' | wc -l) pages"

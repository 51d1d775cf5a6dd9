#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What the pages (*.md, docs/*.md, evaluation's) tell people to type and to open is there: each `./dev` verb and bench, each link to
# a file, and what configures in "Install" and the commands of "Build from source", on copies of what a package installs.
# Usage: tests/readme.sh BUILD_FOLDER
set -euo pipefail
build=$(cd "$1" && pwd)
cd "$(dirname "${BASH_SOURCE[0]}")/.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
bad=0
problem() { echo "readme: $1" >&2 && bad=1; }

verbs=$(echo help && ./dev help | sed -nE 's/^  ([a-z-]+).*/\1/p')
benches=$(./dev bench | sed -nE 's/^  ([a-z]+).*/\1/p')
mapfile -t commands < <(cat ./*.md docs/*.md evaluation/README.md evaluation/outages/README.md | grep -oE '\./dev( [a-z0-9-]+)*' | sort -u)
[ ${#commands[@]} -gt 9 ] || problem 'finds no commands'
for command in "${commands[@]}"; do
  read -ra words <<<"$command"
  [ ${#words[@]} -gt 1 ] || continue
  grep -qx -- "${words[1]}" <<<"$verbs" || problem "no verb: $command"
  [ "${words[1]}" != bench ] || [ ${#words[@]} -eq 2 ] || grep -qx -- "${words[2]}" <<<"$benches" ||
    problem "no bench: $command"
done

for page in ./*.md docs/*.md evaluation/README.md evaluation/outages/README.md; do
  while read -r target; do
    [ -e "$(dirname "$page")/$target" ] || problem "$page: no file $target"
  done < <(grep -oE '\]\([^)#]+' "$page" | cut -c3- | grep -v '^https\?:')
done

# section HEADING: its commands, the indented lines.
section() { awk -v heading="## $1" '/^## / { on = $0 == heading } on && /^    / { print substr($0, 5) }' README.md; }

cp "$build"/systemd/*.toml "$folder/"
section Install | sed -nE "s|^sudo (orbbuf-server add-robot .*)|$build/server/\\1 --folder $folder --server 192.0.2.1|p
  s|^sudo (orbbufd setup) |$build/daemon/\\1 --folder $folder --camera generated --force $folder/robots/|p" >"$folder/install.sh"
[ "$(wc -l <"$folder/install.sh")" -eq 2 ] || problem 'Install: not the two commands that configure'
bash -e "$folder/install.sh" >"$folder/said" 2>&1 || { cat "$folder/said" >&2 && problem 'Install: a command fails'; }
grep -q '^server = "192.0.2.1:7722"' "$folder/orbbufd.toml" || problem 'Install: not the server'
mkdir "$folder/credentials"
ln -s ../ca.crt "$folder/credentials/ca"
for program in daemon/orbbufd server/orbbuf-server; do
  keys=${program#*/} && keys=${keys#orbbuf-} # as the units name them
  ln -sf "../$keys.crt" "$folder/credentials/certificate"
  ln -sf "../$keys.key" "$folder/credentials/key"
  CREDENTIALS_DIRECTORY=$folder/credentials "$build/$program" --check-config --config "$folder/${program#*/}.toml" ||
    problem "Install: $program"
done

ran=0
while read -r command; do
  case $command in
    *--list-cameras) ;;
    *) command="$command --check-config" ;;
  esac
  (cd "$folder" && bash -c "${command//SERVER/192.0.2.1}" >/dev/null) || problem "fails: $command"
  ran=$((ran + 1))
done < <(section 'Build from source' | sed -En "s#^build/(server|robot)/#$build/#p")
[ $ran -eq 3 ] || problem "Build from source: $ran commands, not 3"
exit $bad

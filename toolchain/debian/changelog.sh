#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Prints Debian's form of CHANGELOG.md. Usage: toolchain/debian/changelog.sh CHANGELOG PACKAGE RELEASE MAINTAINER
set -euo pipefail
sign() { [ -z "$date" ] || printf '\n -- %s  %s\n' "$1" "$(LC_ALL=C date -R -u -d "$date")"; }
date=
while IFS= read -r line; do
  if [[ $line =~ ^'## '([0-9.]+)' ('([0-9-]+)')'$ ]]; then
    sign "$4"
    [ -z "$date" ] || echo
    date=${BASH_REMATCH[2]}
    printf '%s (%s-%s) stable; urgency=medium\n\n' "$2" "${BASH_REMATCH[1]}" "$3"
  elif [ -n "$date" ] && [[ $line =~ ^'- '(.*) ]]; then
    printf '  * %s\n' "${BASH_REMATCH[1]}"
  elif [ -n "$date" ] && [[ $line =~ ^'  '(.*) ]]; then
    printf '    %s\n' "${BASH_REMATCH[1]}"
  fi
done <"$1"
sign "$4"

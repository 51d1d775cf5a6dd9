# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# For scripts that make a Debian of their own.

# own_release: this machine's, e.g. bookworm.
own_release() { (. /etc/os-release && echo "$VERSION_CODENAME"); }

# debian_sources RELEASE: apt's lines for it, from where this machine has its own Debian. Without updates: what is linked
# against the older library runs with the newer one, too.
debian_sources() {
  local lines own
  own=$(own_release)
  # shellcheck disable=SC2016 # apt's variables
  lines=$(apt-get indextargets 'Created-By: Packages' 'Origin: Debian' "Codename: $own" \
    --format 'deb $(REPO_URI) $(CODENAME) $(COMPONENT)' | sort -u)
  [ -n "$lines" ] || { echo 'apt knows of no Debian; as root: apt-get update' >&2 && return 1; }
  echo "${lines// $own / $1 }"
}

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The bench of the link, between two network namespaces: how soon frames come after an outage, side
# by side with a plain TCP connection and with roscpp, over round trips of up to 2 s, and with a name
# server behind it; how soon they come over the second of two links when one fails; what attempts to connect cost; how much of the link's rate is frames, what stands
# in the kernel's queue, and what a slow SLAM program finds.
# Usage: bench/link/run.sh BUILD_FOLDER [--full|--quick] [--seed N]
#          [--only return|path|name|failover|cost|goodput|queue|reader]
# About 45 minutes; --full repeats the long outages twenty times too (2 hours), --quick is a look.
set -euo pipefail
build=$(cd "$1" && pwd)
shift
here=$(dirname "${BASH_SOURCE[0]}")
plan=(0.3:20 0.5:20 1:20 2:20 5:20 20:3 60:2) path_plan=(1:5 5:5) name_repeats=3 failovers=10
rates=(0.5 2 10 50 100) only='' seed=1
while [ $# -gt 0 ]; do
  case $1 in
    --full) plan=(0.3:20 0.5:20 1:20 2:20 5:20 20:20 60:20) path_plan=(1:20 5:20) name_repeats=20 failovers=20 ;;
    --quick) plan=(0.5:4 1:4 2:4 5:2) path_plan=(2:2) name_repeats=1 failovers=4 rates=(2 50) ;;
    --seed) seed=$2 && shift ;;
    --only) only=$2 && shift ;;
    *) echo "bench link: unknown option $1" >&2 && exit 2 ;;
  esac
  shift
done
RANDOM=$seed
results=()

# shellcheck source=bench/link/rig.sh
. "$here/rig.sh"
# shellcheck source=bench/link/return.sh
. "$here/return.sh"
# shellcheck source=bench/link/path.sh
. "$here/path.sh"
# shellcheck source=bench/link/failover.sh
. "$here/failover.sh"
# shellcheck source=bench/link/goodput.sh
. "$here/goodput.sh"
# shellcheck source=bench/link/queue.sh
. "$here/queue.sh"
# shellcheck source=bench/link/reader.sh
. "$here/reader.sh"

rig_up
echo "bench link: seed $seed; OUTAGE:REPEATS ${plan[*]}; 20 Mbit/s; nftables drop at the server"
wants() { [ -z "$only" ] || [ "$only" = "$1" ]; }
! wants return || returns "${plan[@]}"
! wants path || { paths "${path_plan[@]}" && tls_connects; }
! wants name || names "$name_repeats"
! wants failover || failovers "$failovers"
! wants cost || attempt_cost
! wants goodput || goodput 2 10 50
! wants queue || queues "${rates[@]}"
! wants reader || slow_readers
printf '%s\n' "${results[@]}"

#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The bench of the link, between two network namespaces. Each part can be run alone:
#   return    how soon frames come after an outage; orbbufd has the link to itself
#   tls       the same under TLS
#   rivals    the same for orbbufd under bbr, a plain TCP connection and roscpp, side by side
#   quic      the same for a file by QUIC, of ngtcp2
#   path      the same over round trips of up to 2 s, plain and under TLS
#   name      the same with a name server behind the outage, and SIGTERM in the middle of a lookup
#   live      when the stream is live again, over queues, bursts and congestion controls; what arrives of an
#             outage; what a link of half and a quarter of the need delivers
#   failover  how soon frames come over the second of two links when one fails
#   servers   how soon frames come at the second of two servers when the first is killed, or cut off
#   cost      what attempts to connect send while the link is down
#   lte       over recorded mobile links: how many attempts there are, and what they cost
#   slow      64 kbit/s, and a queue of 2 s that others keep full
#   goodput   how much of the link's rate is frames
#   beside    what 1 kHz of samples costs the frames
#   queue     what stands in the kernel's queue
#   reader    what a slow SLAM program finds
# Usage: bench/link/run.sh BUILD_FOLDER [--full|--quick] [--seed N] [--only PART[,PART...]]
#          [--outages SECONDS[,SECONDS...]] [--repeats N] [--round-trips MS[,MS...]] [--seconds N]
# --full repeats the long outages twenty times too, --quick is a look. --outages and --repeats are for
# the outages of the parts; --repeats for the failures of `failover` and `servers`, too; --round-trips for `path`;
# --seconds for each link of `lte`. The traces are in $ORBBUF_TRACES.
set -euo pipefail
build=$(cd "$1" && pwd)
shift
here=$(dirname "${BASH_SOURCE[0]}")
plan=(0.3:20 0.5:20 1:20 2:20 5:20 20:3 60:2) path_plan=(1:5 5:5) live_plan=(2:3 5:3 20:3 60:1) lives=5 name_repeats=3 failovers=10
rates=(0.5 2 10 50 100) round_trips=(50 300 600 2000) only='' seed=1 outages=() repeats='' lte_seconds=120
while [ $# -gt 0 ]; do
  case $1 in
    --full) plan=(0.3:20 0.5:20 1:20 2:20 5:20 20:20 60:20) path_plan=(1:20 5:20) name_repeats=20 failovers=20 ;;
    --quick) plan=(0.5:4 1:4 2:4 5:2) path_plan=(2:2) live_plan=(2:1) lives=1 name_repeats=1 failovers=4 rates=(2 50) lte_seconds=20 ;;
    --seed) seed=$2 && shift ;;
    --only) only=$2 && shift ;;
    --outages) IFS=, read -ra outages <<<"$2" && shift ;;
    --repeats) repeats=$2 lives=$2 name_repeats=$2 failovers=$2 && shift ;;
    --seconds) lte_seconds=$2 && shift ;;
    --round-trips) IFS=, read -ra round_trips <<<"$2" && shift ;;
    *) echo "bench link: unknown option $1" >&2 && exit 2 ;;
  esac
  shift
done
if [ ${#outages[@]} -gt 0 ]; then
  plan=("${outages[@]/%/:${repeats:-20}}") path_plan=("${outages[@]/%/:${repeats:-5}}")
  live_plan=("${outages[@]/%/:${repeats:-3}}")
elif [ -n "$repeats" ]; then
  plan=("${plan[@]/%:*/:$repeats}") path_plan=("${path_plan[@]/%:*/:$repeats}")
  live_plan=("${live_plan[@]/%:*/:$repeats}")
fi
RANDOM=$seed

# shellcheck source=bench/link/rig.sh
. "$here/rig.sh"
# shellcheck source=bench/link/return.sh
. "$here/return.sh"
# shellcheck source=bench/link/path.sh
. "$here/path.sh"
# shellcheck source=bench/link/live.sh
. "$here/live.sh"
# shellcheck source=bench/link/failover.sh
. "$here/failover.sh"
# shellcheck source=bench/link/servers.sh
. "$here/servers.sh"
# shellcheck source=bench/link/lte.sh
. "$here/lte.sh"
# shellcheck source=bench/link/slow.sh
. "$here/slow.sh"
# shellcheck source=bench/link/goodput.sh
. "$here/goodput.sh"
# shellcheck source=bench/link/beside.sh
. "$here/beside.sh"
# shellcheck source=bench/link/queue.sh
. "$here/queue.sh"
# shellcheck source=bench/link/reader.sh
. "$here/reader.sh"

rig_up
echo "bench link: seed $seed; OUTAGE:REPEATS ${plan[*]}; 20 Mbit/s; nftables drop at the server"
wants() { [ -z "$only" ] || [[ ,$only, == *,$1,* ]]; }
! wants return || returns "${plan[@]}"
! wants tls || returns_tls "${plan[@]}"
! wants rivals || returns_of_rivals "${plan[@]}"
! wants quic || returns_of_quic "${plan[@]}"
! wants path || paths "${path_plan[@]}"
! wants live || lives "$lives" "${live_plan[@]}"
! wants name || names "$name_repeats"
! wants failover || failovers "$failovers"
! wants servers || lost_servers "$failovers"
! wants cost || attempt_cost
! wants lte || mobile_links "$lte_seconds"
! wants slow || slow_link
! wants goodput || goodput 2 10 50
! wants beside || beside
! wants queue || queues "${rates[@]}"
! wants reader || slow_readers

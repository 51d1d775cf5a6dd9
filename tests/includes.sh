#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Refuses an include between two folders of common/, daemon/, server/ and evaluation/ that the list below does not allow.
# A folder is listed before all that may include it, so no two can include each other, however far around.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# FOLDER: the folders that its sources may include, besides itself. A file that stands above or below the rest of
# its folder has a line of its own, by its name without the ending.
allowed() {
  cat <<'ALLOWED'
common:
common/journal: common
common/net: common
common/calibration: common
common/dds: common common/calibration
daemon/mailbox: common
daemon/topics: common common/dds daemon/mailbox
daemon/buffer: common
daemon/capture: common
daemon/capture/libcamera: common daemon/capture
daemon/capture/replay: common daemon/capture
daemon/capture/ros2: common daemon/topics daemon/capture
daemon/capture/stereo: common daemon/capture
daemon/capture/v4l2: common daemon/capture
daemon/capture/list_cameras: daemon/capture/libcamera daemon/capture/v4l2
daemon/capture/make_source: daemon/capture daemon/capture/libcamera daemon/capture/replay daemon/capture/ros2 daemon/capture/stereo daemon/capture/v4l2
daemon/image: common daemon/buffer daemon/capture
daemon/record: common common/journal
daemon/samples: common daemon/capture daemon/capture/replay daemon/topics
daemon/net: common common/net daemon/buffer daemon/record daemon/samples
daemon/settings: common common/calibration daemon/buffer daemon/capture daemon/image daemon/net daemon/record daemon/samples
daemon: common common/calibration common/net daemon/topics daemon/mailbox daemon/buffer daemon/capture daemon/image daemon/net daemon/samples daemon/settings daemon/capture/list_cameras daemon/capture/make_source
server/runtime: common
server/session: common common/journal common/calibration server/runtime
server/foxglove: common common/calibration
server/dataset/mcap: common server/runtime server/session common/calibration server/foxglove
server/dataset: common common/journal common/calibration server/session server/dataset/mcap
server/retention: common common/journal server/runtime server/session
server/live: common server/session
server/sink: common server/session
server/sink/pipe: common server/runtime server/session server/sink
server/sink/losses: common
server/sink/paced_sink: common server/runtime server/session server/sink server/sink/losses
server/sink/dds: common common/dds server/session server/sink server/sink/paced_sink
server/sink/ros: common common/calibration server/session server/sink server/sink/paced_sink
server/sink/make_sinks: common server/runtime server/session server/sink server/sink/pipe server/sink/dds server/sink/ros
server/settings: common common/net server/live server/retention server/sink/make_sinks
server/http: common common/journal common/net server/runtime common/calibration server/session server/foxglove server/live server/settings
server/link: common common/net server/runtime server/session server/live server/sink server/sink/make_sinks server/settings
bench:
bench/sim:
evaluation: common/calibration
evaluation/world: common bench evaluation
evaluation/odometry: common bench evaluation
evaluation/imu: common bench evaluation evaluation/odometry
evaluation/trial: common bench daemon/buffer daemon/image bench/sim evaluation evaluation/odometry
evaluation/outages: common bench daemon/buffer daemon/capture/make_source daemon/image bench/sim evaluation/odometry evaluation/trial
evaluation/real: common bench bench/sim
evaluation/quality: common bench daemon/buffer daemon/image bench/sim evaluation evaluation/odometry evaluation/trial
server: common common/net server/runtime server/session server/dataset server/dataset/mcap server/retention server/live server/sink/make_sinks server/settings server/http server/link
ALLOWED
}

# Each include of one of our files: FILE INCLUDED.
includes() {
  grep -rhoE --include='*.[ch]pp' --include='*.h' '^#include "[^"]+"' common daemon server evaluation --with-filename |
    sed -E 's/:#include "(.*)"/ \1/'
}

# What is generated (http/page_parts.hpp) is in no folder but the one that includes it.
awk '
  function room(file, name) {
    name = file
    sub(/[.][^.\/]*$/, "", name)
    if (name in rank) return name
    sub(/\/[^\/]*$/, "", name)
    return name
  }
  FILENAME == "-" || NR == FNR {
    from = $1
    sub(/:$/, "", from)
    rank[from] = NR
    for (i = 2; i <= NF; ++i) {
      if (!($i in rank)) {
        print "includes: " $i " is not listed above " from ", which may include it"
        bad = 1
      }
      may[from, $i] = 1
    }
    next
  }
  {
    from = room($1)
    to = room($2)
    if (!(from in rank)) {
      print "includes: no line for " from " (" $1 ")"
      bad = 1
    } else if (from != to && !((from, to) in may)) {
      print "includes: " $1 " includes " $2 ": " from " may not include " to
      bad = 1
    }
    used[from, to] = 1
    ++count
  }
  END {
    for (pair in may) if (!(pair in used)) {
      split(pair, ends, SUBSEP)
      print "includes: " ends[1] " no longer includes " ends[2] ": strike it from the list"
      bad = 1
    }
    if (count < 300) {
      print "includes: found only " count + 0 " includes"
      bad = 1
    }
    exit bad
  }
' <(allowed) <(includes) >&2

# shellcheck shell=bash
# SPDX-License-Identifier: Apache-2.0
# What every case needs: a server, a daemon that captures, waiting, and a verdict.

frames=/tmp/frames # the server's folder
log=/tmp/daemon.log
daemon=
as=() # a command that starts the daemon
problems=

# wait_for SECONDS COMMAND...: until the command succeeds. There is no event to wait for here.
wait_for() {
  local end=$((SECONDS + $1))
  shift
  until "$@"; do
    [ $SECONDS -lt $end ] || return 1
    sleep 0.2
  done
}

# expect WHAT COMMAND...: notes WHAT as a problem of this case unless the command succeeds.
expect() {
  local what=$1
  shift
  "$@" || problems="$problems; $what"
}

# verdict CASE: PASS or FAIL, and the log where it failed.
verdict() {
  if [ -z "$problems" ]; then
    echo "PASS $1"
  else
    echo "FAIL $1: ${problems#; }"
    sed 's/^/    /' "$log" | tail -n 40
  fi
  problems=
}

start_server() {
  orbbuf-server --set listen.address=127.0.0.1:7722 --set "files.path=$frames" >server.log 2>&1 &
  wait_for 30 grep -q 'listening' server.log
}

# capture ROBOT SETTING...: starts the daemon with [source] SETTINGs.
capture() {
  local robot=$1 arguments=(--set "jpeg.color=${color:-false}") setting
  shift
  for setting in "$@"; do arguments+=(--set "source.$setting"); done
  "${as[@]}" orbbufd --set "robot.id=$robot" --set source.kind=v4l2 "${arguments[@]}" >"$log" 2>&1 &
  daemon=$!
}

# ends_with STATUS: whether the daemon ends so, soon. One that hangs is killed, and where each of its
# threads stood is printed.
ends_with() {
  local task
  if ! wait_for 60 daemon_has_ended; then
    for task in /proc/"$daemon"/task/*; do
      echo "    hangs: $(cat "$task/comm"), $(cat "$task/syscall")"
      sed 's/^/        /' "$task/stack"
    done
    kill -KILL "$daemon"
  fi
  wait "$daemon"
  [ $? -eq "$1" ]
}
daemon_has_ended() { ! kill -0 "$daemon" 2>/dev/null || grep -q '^State:.Z' "/proc/$daemon/status"; }

# end_capture: the daemon stops as it should.
end_capture() {
  kill -TERM "$daemon"
  expect 'exit status' ends_with 0
}

session_of() { echo "$frames/$1"/*; }
frame_count() { find "$frames/$1" -name '*.jpg' 2>/dev/null | wc -l; }
has_frames() { [ "$(frame_count "$1")" -ge "$2" ]; }

# logged COUNT TEXT: the daemon's log has at least so many lines with the text.
logged() { [ "$(grep -c -- "$2" "$log")" -ge "$1" ]; }

# size_of JPEG: WxH, from the frame header.
size_of() {
  local hex
  hex=$(od -An -v -tx1 -N 1000 "$1" | tr -d ' \n' | grep -oE 'ffc000[01].08.{8}' | head -n 1)
  echo $((16#${hex:14:4}))x$((16#${hex:10:4}))
}

# components_of JPEG: 1 is gray, 3 is colour.
components_of() {
  local hex
  hex=$(od -An -v -tx1 -N 1000 "$1" | tr -d ' \n' | grep -oE 'ffc000[01].08.{10}' | head -n 1)
  echo $((16#${hex:18:2}))
}

times_increase() { sort -c -u -k 2,2 "$(session_of "$1")/times.txt"; }

# row ROBOT FPS: the names of 100 images of frames taken one right after the other, none lost in the
# driver (their times), none behind it (their numbers), and at the camera's rate. Not simply the first
# 100: on a busy host the guest stands still now and then, and loses frames at either place.
row() {
  awk -v fps="$2" '
    { step = ($2 - time) * fps }
    NR > 1 && $1 == id + 1 && step > 0.3 && step < 1.7 { ++length_ }
    NR == 1 || $1 != id + 1 || step <= 0.3 || step >= 1.7 { length_ = 1 }
    { id = $1; time = $2; times[id] = time }
    length_ >= 100 {
      rate = 99 / (time - times[id - 99])
      if (rate < 0.97 * fps || rate > 1.03 * fps) next
      found = 1
      for (i = id - 99; i <= id; ++i) printf "%06d.jpg\n", i
      exit
    }
    END { exit !found }' "$(session_of "$1")/times.txt" 2>/dev/null
}
has_row() { row "$@" >row.txt; }

# all_accounted: every frame has its place, whatever happened.
all_accounted() {
  sed -n 's/.*session ended: captured \(.*\)/\1/p' "$log" | tr -dc '0-9 ' |
    awk '{ exit !($1 > 0 && $1 == $2 + $3 + $4 + $5 + $6 + $7) }'
}

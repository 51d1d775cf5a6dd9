// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace orbbuf {

/// Starts `sh -c command` with `input` as its standard input, `output` as its standard output and
/// error, and no other descriptor of ours; in a process group of its own, with SIGPIPE as usual.
/// environment: `NAME=value`, laid over our own, of which it gets neither systemd's credentials
/// (the keys of TLS) nor its notification socket and watchdog. Zero, or an errno value.
int spawn(const std::string& command, const std::vector<std::string>& environment, int input,
          int output, pid_t* pid);

}  // namespace orbbuf

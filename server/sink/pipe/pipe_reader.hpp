// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "common/error.hpp"
#include "common/unique_fd.hpp"

namespace orbbuf {

/// Who reads a session's pipe, and how to get hold of them. Thread-bound to `main`.
class PipeReader {
 public:
  virtual ~PipeReader() = default;

  /// The writing end of a pipe that has a reader; empty if it has none yet. Closing it shows the
  /// reader the end. Never blocks. Called again when the pipe broke or `gone` ran.
  /// gone: runs, before the next connect(), when the reader has left in a way that the pipe itself
  /// may not show; possibly when the pipe is long closed.
  virtual Result<UniqueFd> connect(std::function<void()> gone) = 0;

  /// For the log.
  virtual std::string name() const = 0;
};

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <memory>
#include <string>
#include <vector>

#include "server/sink/pipe_reader.hpp"

namespace orbbuf {

/// A shell command that reads a session's pipe as its standard input, started anew by each open()
/// after it has ended.
///
/// The child has the server's standard output and error, no other descriptor of it, its own process
/// group (so that Ctrl-C at the server reaches it as the end of its input), and SIGPIPE as usual.
/// It is never killed: it is told by the end of its input. Whenever it exits it is reaped on `main`
/// and the status is logged, also after this object is gone.
class ChildProcess final : public PipeReader {
 public:
  /// environment: `NAME=value`, laid over the server's own. `main` must outlive the object.
  ChildProcess(boost::asio::io_context& main, std::string command,
               std::vector<std::string> environment);

  /// Starts the command, and is an error if that fails. Empty while the last child still runs.
  Result<UniqueFd> open() override;
  std::string name() const override;

 private:
  struct Child;

  boost::asio::io_context& main_;
  const std::string command_;
  const std::vector<std::string> environment_;
  std::shared_ptr<Child> child_;
  std::shared_ptr<std::string> last_exit_;  // shared with children: a crash loop logs one warning
};

}  // namespace orbbuf

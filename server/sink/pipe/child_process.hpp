// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/sink/pipe/pipe_reader.hpp"

namespace orbbuf {

/// What follows the end of a session's command.
enum class Restart : std::uint8_t {
  kAlways,     ///< another start
  kOnFailure,  ///< another start, unless it exited with status 0
  kNever,      ///< nothing more in this session
};

/// When a command is started again: at once if it ran for kLongRun, later and later if not, up to
/// kLongest. Reentrant.
class Backoff {
 public:
  using Duration = std::chrono::nanoseconds;
  static constexpr Duration kLongRun = std::chrono::seconds(10);
  static constexpr Duration kLongest = std::chrono::seconds(30);

  /// How long to wait after a run of that length.
  Duration after(Duration run);

 private:
  Duration next_{0};
};

/// A shell command that reads a session's pipe as its standard input, started again by connect()
/// after it has ended, as `restart` has it.
///
/// The child has no descriptor of the server but that input and its output, which goes to the log
/// (ChildOutput); its own process group, so that Ctrl-C at the server reaches it as the end of its
/// input; and SIGPIPE as usual. When it exits it is reaped on `main`, its status is logged, also
/// after this object is gone, and its pipe has lost its reader, whatever other processes it left
/// behind with a copy of either end.
///
/// The child's input ends when this object is destroyed, or before. If the child still runs
/// Patience::with_end later, its process group gets SIGTERM, and after Patience::with_term SIGKILL.
class ChildProcess final : public PipeReader {
 public:
  struct Patience {
    std::chrono::milliseconds with_end{60'000};  ///< SLAM may have a map to finish and to save
    std::chrono::milliseconds with_term{10'000};
  };

  /// label: whose it is, for the log. environment: `NAME=value`, laid over the server's own. `main`
  /// must outlive the object.
  ChildProcess(boost::asio::io_context& main, std::string label, std::string command,
               std::vector<std::string> environment, Restart restart);
  ChildProcess(boost::asio::io_context& main, std::string label, std::string command,
               std::vector<std::string> environment, Restart restart, Patience patience);
  ~ChildProcess() override;
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// Starts the command, and is an error if that fails. Empty while the last child still runs, or
  /// it is too early or too late for another one. gone: the child has ended.
  Result<UniqueFd> connect(std::function<void()> gone) override;
  std::string name() const override { return "command \"" + command_ + "\""; }

 private:
  struct Child;
  struct History;

  std::optional<Error> watch(pid_t pid, UniqueFd output, std::function<void()> gone);

  boost::asio::io_context& main_;
  const std::string command_;
  const std::vector<std::string> environment_;
  const std::shared_ptr<History> history_;  // shared with the child
  const Patience patience_;
  std::shared_ptr<Child> child_;
};

}  // namespace orbbuf

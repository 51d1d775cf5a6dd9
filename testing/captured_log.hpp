// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

namespace spdlog {
class logger;
}

namespace orbbuf::test {

/// Takes the log for as long as it lives: `LEVEL TEXT` a line. Made and destroyed when no other
/// thread logs.
class CapturedLog {
 public:
  CapturedLog();
  ~CapturedLog();
  CapturedLog(const CapturedLog&) = delete;
  CapturedLog& operator=(const CapturedLog&) = delete;

  /// The lines that contain `text`.
  std::vector<std::string> lines(const std::string& text = "") const;
  /// Until there are that many such lines. Throws std::runtime_error, with the log, if that takes
  /// longer than a minute.
  void wait_for(const std::string& text, std::size_t times = 1) const;

 private:
  class Sink;

  const std::shared_ptr<Sink> sink_;
  const std::shared_ptr<spdlog::logger> before_;
};

}  // namespace orbbuf::test

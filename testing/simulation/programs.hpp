// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace orbbuf::simulation {

/// A program of which machines are started, each as a copy of one process that has not begun yet.
class Program {
 public:
  /// With `library` preloaded; run by `emulator`, the words of a command, if there are any. Throws
  /// std::runtime_error.
  Program(const std::filesystem::path& file, const std::filesystem::path& library, int memory,
          std::vector<std::string> emulator);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  /// The machine is on, and its program begins when its thread has the turn.
  void start(int machine, const std::vector<std::string>& arguments);
  /// As kill -9, or for one that has ended by itself; returns when the process is gone.
  void kill(int machine);

 private:
  int ask(const std::string& request) const;

  int socket_ = -1;
  int process_ = -1;
};

}  // namespace orbbuf::simulation

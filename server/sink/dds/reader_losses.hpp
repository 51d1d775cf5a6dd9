// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <utility>

#include "common/log.hpp"

namespace orbbuf {

/// What reliable readers of this process's topics have missed, since they are slower than the
/// writer's history is deep, or have stopped: counted for each from when it was first seen, and
/// logged at most every 10 s. One thread.
class ReaderLosses {
 public:
  /// At all writers of a participant. What went between two looks through the history and out of
  /// it counts in the next one.
  void look(int participant);

 private:
  using Guid = std::array<unsigned char, 16>;
  struct Reader {
    std::uint64_t gone = 0;  // up to here it has the messages, or they are counted
    std::uint64_t missed = 0;
    std::uint64_t logged = 0;
    LogLimit limit{std::chrono::seconds{10}};
  };
  using Readers = std::map<std::pair<int, Guid>, Reader>;  // by writer and reader

  void look_at(int writer, Readers& seen);

  Readers readers_;
};

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <iterator>
#include <map>

#include "common/frame.hpp"

namespace orbbuf {

/// Numbers that mostly follow each other: it takes room for each run of them, not for each number.
/// All are below the largest Sequence.
class SequenceSet {
 public:
  /// False: it is there already.
  bool insert(Sequence number) {
    auto next = runs_.upper_bound(number);
    if (next != runs_.begin()) {
      auto run = std::prev(next);
      if (number < run->second) return false;
      if (number == run->second) {
        ++run->second;
        if (next != runs_.end() && next->first == run->second) {
          run->second = next->second;
          runs_.erase(next);
        }
        return true;
      }
    }
    Sequence end = number + 1;
    if (next != runs_.end() && next->first == end) {
      end = next->second;
      runs_.erase(next);
    }
    runs_.emplace(number, end);
    return true;
  }

  bool contains(Sequence number) const {
    const auto next = runs_.upper_bound(number);
    return next != runs_.begin() && number < std::prev(next)->second;
  }

  bool empty() const { return runs_.empty(); }
  /// Runs of numbers without a gap: the first, and the one behind the last.
  const std::map<Sequence, Sequence>& runs() const { return runs_; }

 private:
  std::map<Sequence, Sequence> runs_;
};

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "common/frame.hpp"
#include "common/wire.hpp"

namespace orbbuf::powercut {

/// What a robot captures, step by step: a frame, which may be dropped or reduced, samples, and a
/// message of a topic. A reduced frame comes whole later; some dropped frames, samples and messages
/// come late. Robot 0 has one camera and no topic, the others have two cameras and a topic.
/// Reentrant.
class Content {
 public:
  explicit Content(int robot) : robot_(robot) {}

  bool is_stereo() const { return robot_ > 0; }
  /// Of samples, and of messages if there is a topic.
  std::vector<wire::StreamDeclaration> streams() const;
  static std::uint64_t items_a_step(wire::StreamId stream);

  static bool is_dropped(Sequence step) { return step % 7 == 3; }
  static bool is_reduced(Sequence step) { return step % 5 == 2 && !is_dropped(step); }
  /// The frame as it is sent live.
  EncodedFrame live(Sequence step) const;
  EncodedFrame whole(Sequence step) const { return frame(step, false); }

  /// The drop record, the samples and the message of the step.
  std::vector<wire::Items> items(Sequence step) const;
  /// They are not sent live.
  static bool are_late(const wire::Items& items, Sequence step) {
    return items.stream >= wire::kFirstOther && step % 11 == 5;
  }

  /// What is sent late: items, or the whole frame.
  struct Late {
    Sequence step = 0;
    std::optional<wire::Items> items;
  };
  std::vector<Late> lates(Sequence step) const;

 private:
  EncodedFrame frame(Sequence step, bool is_reduced) const;

  const int robot_;
};

}  // namespace orbbuf::powercut

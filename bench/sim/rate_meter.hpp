// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace orbbuf::sim {

/// The rate of a link, measured from the sends that have ended: their bytes over the time they
/// took, older ones counted less, with a time constant of one second of sending. A send that took
/// more than four times as long as the rate so far predicts counts as four times: it met an outage,
/// which says nothing of the rate after it.
class RateMeter {
 public:
  void on_sent(std::size_t bytes, double seconds);

  /// 0 before the first send.
  double bytes_per_s() const { return seconds_ > 0 ? bytes_ / seconds_ : 0; }

 private:
  double bytes_ = 0;
  double seconds_ = 0;
};

}  // namespace orbbuf::sim

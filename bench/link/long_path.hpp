// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>

namespace orbbuf::bench {

/// The share of packets, 0 to 1, to which each of these happens; by a fixed seed.
struct PacketFaults {
  double reorder = 0;  ///< takes 10 ms longer than the others
  double repeat = 0;   ///< comes twice
  double flip = 0;     ///< two words of its payload change places, which TCP's checksum cannot see
};

/// Makes two network interfaces, the ends of a path on which each packet takes `delay`, and carries
/// packets between them until the process is killed. One of them may be moved to another network
/// namespace. trace: empty, or a file of mahimahi's, the milliseconds at which a recorded link took
/// 1500 bytes: then packets from `near_end` wait for these, again and again. Prints a line when
/// both exist. Throws std::system_error; only root can make them.
[[noreturn]] void carry_packets(const std::string& near_end, const std::string& far_end,
                                std::chrono::nanoseconds delay, const std::string& trace,
                                const PacketFaults& faults = {});

}  // namespace orbbuf::bench

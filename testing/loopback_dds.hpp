// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdlib>

namespace orbbuf::test {

/// Before the first participant of the process, which meets no program on another machine so.
/// domain: one for each test program, since several run at once.
inline void use_loopback_dds(const char* domain) {
  ::setenv("ROS_DOMAIN_ID", domain, 1);
  ::setenv("CYCLONEDDS_URI",
           "<General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces>"
           "</General>",
           1);
}

}  // namespace orbbuf::test

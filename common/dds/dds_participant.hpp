// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

namespace orbbuf {

/// This process as other DDS programs see it. Cyclone DDS runs threads of its own.
class DdsParticipant {
 public:
  /// In the domain $ROS_DOMAIN_ID (without it 0); $CYCLONEDDS_URI configures Cyclone DDS. Throws
  /// std::runtime_error if there is no network interface, or one of these is wrong, or the process
  /// has a participant in the domain already.
  DdsParticipant();
  /// The one of the process, which is made if nothing has it; not to be called by several threads
  /// at a time. Throws likewise.
  static std::shared_ptr<const DdsParticipant> shared();
  /// Waits up to 1 s (Cyclone's LingerDuration) for readers that lack messages. If the network that
  /// it used is gone, Cyclone never ends: after 5 s it is left behind, which is logged.
  ~DdsParticipant();
  DdsParticipant(const DdsParticipant&) = delete;
  DdsParticipant& operator=(const DdsParticipant&) = delete;

  int entity() const { return entity_; }
  std::uint32_t domain_id() const { return domain_id_; }

 private:
  std::uint32_t domain_id_;
  int domain_;
  int entity_;
};

/// Those of a participant.
std::vector<int> writers_of(int participant);

/// `entity`, which a call of Cyclone DDS returned. Throws std::runtime_error, `dds: cannot ATTEMPT:
/// why`, if it is an error.
int require_dds(int entity, std::string_view attempt);

}  // namespace orbbuf

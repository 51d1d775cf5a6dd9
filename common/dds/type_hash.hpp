// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

struct dds_qos;

namespace orbbuf {

/// Has a reader or writer announce the hash of its type, one of those that this project makes
/// itself, as ROS 2 from Iron on does and otherwise warns. type: as DDS has it.
void set_type_hash(dds_qos* qos, std::string_view type);

/// Whether what was announced has one: the other end is of ROS 2 from Iron on.
bool has_type_hash(const dds_qos* qos);

}  // namespace orbbuf

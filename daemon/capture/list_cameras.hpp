// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace orbbuf {

/// What `orbbufd --list-cameras` prints: every V4L2 camera of this machine with its node, name,
/// bus, formats, sizes, rates and controls, or why its node cannot be opened. Nodes that do not
/// capture are left out. Throws std::runtime_error if this program was built without V4L2.
std::string list_cameras();

}  // namespace orbbuf

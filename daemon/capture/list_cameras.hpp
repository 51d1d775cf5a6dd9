// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace orbbuf {

/// What `orbbufd --list-cameras` prints: every camera of this machine, those of V4L2 by node, with
/// name, bus, formats, sizes, rates and controls, or why the node cannot be opened, then those of
/// libcamera by place and id. One camera may be in both lists. Nodes that do not capture are left
/// out.
std::string list_cameras();

}  // namespace orbbuf

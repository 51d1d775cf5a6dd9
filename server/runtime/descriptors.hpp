// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace orbbuf {

/// Raises this process' limit of open files to what `connections` need, as far as the hard limit
/// lets it; never lowers it. Not to the hard limit as such: commands that a sink runs inherit it,
/// and some of them walk through all descriptors there may be.
void allow_descriptors_for(std::size_t connections);

}  // namespace orbbuf

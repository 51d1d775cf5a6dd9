// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace orbbuf {

/// A copy of `jpeg` with the head that every reader expects: without bytes between its segments,
/// and with the standard Huffman tables (ITU-T T.81, annex K.3) if it is baseline and has none. USB
/// cameras leave them out of Motion JPEG. The copy is unchanged if `jpeg` is broken. Thread-safe.
std::vector<std::uint8_t> with_standard_head(std::span<const std::uint8_t> jpeg);

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace orbbuf {

/// A copy of `jpeg`; if it is baseline and has no Huffman tables, with the standard ones (ITU-T
/// T.81, annex K.3) inserted. USB cameras leave them out of Motion JPEG, and some decoders do not
/// know them. The copy is unchanged if `jpeg` is broken. Thread-safe.
std::vector<std::uint8_t> with_huffman_tables(std::span<const std::uint8_t> jpeg);

}  // namespace orbbuf

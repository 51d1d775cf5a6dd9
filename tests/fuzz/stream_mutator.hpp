// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

/// libFuzzer's own mutation, undirected.
extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

namespace orbbuf::test {

/// Mutates a stream of messages that begins at `data + offset`, and then mostly makes its headers
/// and checksums right again: or hardly one mutation in a billion would get past those. Returns the
/// new size. For a LLVMFuzzerCustomMutator.
std::size_t mutate_stream(std::uint8_t* data, std::size_t size, std::size_t max_size,
                          std::size_t offset, unsigned seed);

}  // namespace orbbuf::test

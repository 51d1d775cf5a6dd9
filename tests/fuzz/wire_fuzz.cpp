// SPDX-License-Identifier: Apache-2.0
// Any bytes as one message: what is accepted must say the same again when it is written and read.
#include <cstdlib>

#include "tests/common/wire_samples.hpp"
#include "tests/fuzz/stream_mutator.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto late = orbbuf::wire::parse_late_record({data, size});
  if (late) {
    const auto& [session_id, frame, items] = late.value();
    const auto again = items ? orbbuf::wire::encode_late_record(session_id, *items)
                             : orbbuf::wire::encode_late_record(session_id, frame);
    if (again != orbbuf::wire::Bytes(data, data + size)) std::abort();
  }
  const auto once = orbbuf::wire::there_and_back({data, size});
  if (!once) return 0;
  const auto twice = orbbuf::wire::there_and_back(once.value());
  if (!twice || twice.value() != once.value()) std::abort();
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t max_size, unsigned seed) {
  return orbbuf::test::mutate_stream(data, size, max_size, 0, seed);
}

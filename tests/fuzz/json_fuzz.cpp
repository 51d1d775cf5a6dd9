// SPDX-License-Identifier: Apache-2.0
// Any text as a message of a Foxglove viewer.
#include <string_view>

#include "server/http/foxglove_protocol.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  orbbuf::foxglove::parse_request({reinterpret_cast<const char*>(data), size});
  return 0;
}

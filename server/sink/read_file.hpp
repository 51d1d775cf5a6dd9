// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "common/error.hpp"

namespace orbbuf {

/// The whole content of a file. Blocking.
Result<std::vector<std::uint8_t>> read_file(const std::filesystem::path& path);

}  // namespace orbbuf

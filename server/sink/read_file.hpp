// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "common/error.hpp"

namespace orbbuf {

/// The whole content of a file. Blocking.
Result<std::string> read_file(const std::filesystem::path& path);

}  // namespace orbbuf

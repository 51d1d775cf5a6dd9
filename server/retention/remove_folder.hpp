// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <filesystem>

#include "common/error.hpp"

namespace orbbuf {

/// Removes a folder and all that is in it, following no link, until `deadline`, by and large. True:
/// it is gone; false: there is more of it. Blocking; reentrant.
Result<bool> remove_folder(const std::filesystem::path& folder,
                           std::chrono::steady_clock::time_point deadline);

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "common/unique_fd.hpp"

namespace orbbuf {

/// Takes the lock (flock) of `folder` itself, so no lock file remains. The lock lasts as long as
/// the descriptor, at most as long as this process. Throws std::runtime_error if another process
/// has it. On a file system that has no such locks it warns, and there is no protection. Never
/// waits.
UniqueFd lock_folder(const std::filesystem::path& folder);

}  // namespace orbbuf

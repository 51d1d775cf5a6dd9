// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace orbbuf {

/// `{"names":[...]}`: the folders in `folder` that are named like robots or sessions, in reverse
/// order, so the newest of those that begin with their time comes first; at most a thousand.
/// Nothing if there is no such folder. Blocking, as is the next.
std::optional<std::string> folders_json(const std::filesystem::path& folder);

/// What a session's folder holds: the bytes of each of its lists, null where it is missing.
std::optional<std::string> session_json(const std::filesystem::path& folder);

}  // namespace orbbuf

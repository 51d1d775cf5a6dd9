// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string_view>

namespace orbbuf {

/// When what was written of a session is brought onto the device.
enum class Durability : std::uint8_t {
  kAck,     ///< before it is acknowledged
  kSecond,  ///< within a second or so
  kOff,     ///< when the kernel does it
};

/// The kind of the file system of `path`, if it is one on which syncfs(2) may not reach the device:
/// `FUSE`, `NFS`, ... Nothing: it is not, or cannot be asked.
std::optional<std::string_view> weak_file_system(const std::filesystem::path& path);
/// The same of statfs(2)'s f_type.
std::optional<std::string_view> weak_kind(std::uint32_t type);

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "common/unique_fd.hpp"

namespace orbbuf {

/// The whole content of a file. Blocking.
Result<std::vector<std::uint8_t>> read_file(const std::filesystem::path& path);

/// The same as text; a file that does not exist is empty. Blocking.
Result<std::string> read_text(const std::filesystem::path& path);

/// Fills `into` from `offset` on as far as the file goes; how many bytes those are. Blocking.
Result<std::size_t> read_at(int fd, std::uint64_t offset, std::span<std::uint8_t> into,
                            const std::filesystem::path& path);

/// Writes all of `bytes`, however many write(2) calls and interruptions it takes. Blocking.
/// `path` is for the error only.
std::optional<Error> write_all(int fd, std::span<const std::uint8_t> bytes,
                               const std::filesystem::path& path);

/// The same from `offset` on, which does not move the descriptor's own.
std::optional<Error> write_all_at(int fd, std::uint64_t offset, std::span<const std::uint8_t> bytes,
                                  const std::filesystem::path& path);

/// Closes `fd`, which is where a network file system reports what it could not write.
std::optional<Error> close_written(UniqueFd fd, const std::filesystem::path& path);

/// Makes `path` with these bytes, complete or not at all: they are written to `temporary`, which is
/// on the same file system and gone afterwards, and renamed. No fsync. Blocking.
std::optional<Error> write_file(const std::filesystem::path& path,
                                const std::filesystem::path& temporary,
                                std::span<const std::uint8_t> bytes);

/// syncfs(2): everything that was written to the file system of `folder` is on its device.
/// Blocking.
std::optional<Error> sync_file_system(const std::filesystem::path& folder);

}  // namespace orbbuf

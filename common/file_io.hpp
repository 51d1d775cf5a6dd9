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

/// All that can be read from a file, which may be a pipe. Blocking.
Result<std::vector<std::uint8_t>> read_file(const std::filesystem::path& path);

/// Opens a file to be read; null: there is none. A FIFO or a device in its place is an error, and
/// no writer is waited for. Blocking.
Result<UniqueFd> open_regular(const std::filesystem::path& path);

/// The whole content of a file that open_regular() opens. Blocking.
Result<std::vector<std::uint8_t>> read_regular(const std::filesystem::path& path);

/// What read_file() reads, as text; a file that does not exist is empty. Blocking.
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

/// Makes `path` with these bytes, in place of a file that is there. is_synced: they are on the
/// device then. After an error a part may be there. Blocking.
std::optional<Error> write_new(const std::filesystem::path& path,
                               std::span<const std::uint8_t> bytes, bool is_synced);

/// rename(2). Blocking.
std::optional<Error> move_file(const std::filesystem::path& from, const std::filesystem::path& to);

/// fsync(2) of a file or a folder. Blocking.
std::optional<Error> sync(const std::filesystem::path& path);

/// Makes `path` with these bytes, complete or not at all: they are written to `temporary`, which is
/// on the same file system and gone afterwards, and renamed. No fsync. Blocking.
std::optional<Error> write_file(const std::filesystem::path& path,
                                const std::filesystem::path& temporary,
                                std::span<const std::uint8_t> bytes);

}  // namespace orbbuf

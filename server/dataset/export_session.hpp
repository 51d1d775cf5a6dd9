// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "common/error.hpp"
#include "server/dataset/layouts.hpp"

namespace orbbuf {

struct ExportReport {
  std::size_t frames = 0;
  std::size_t linked = 0;  ///< images
  std::size_t copied = 0;
  std::vector<std::string> notes;  ///< one line each: what is not in it, and why
};

/// Makes the folder `out`, which must not be there or be empty, of a session, whose images get a
/// second name there where the file system allows it and are copied where not: byte for byte the
/// same. With Layout::kMcap it has one file with all. What is accepted when it begins counts, so
/// that a session may still be recorded.
///
/// An error: no session, no frames, times that do not increase, an image that is missing, or what
/// the system says; `out` is then as it was. Blocking, with its progress on stderr; reentrant.
Result<ExportReport> export_session(const std::filesystem::path& folder,
                                    const std::filesystem::path& out, Layout layout,
                                    std::string_view extension);

}  // namespace orbbuf

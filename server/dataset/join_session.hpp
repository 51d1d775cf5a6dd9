// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "common/error.hpp"

namespace orbbuf {

/// What a join made, and what in the folders did not fit.
struct JoinReport {
  std::size_t parts = 0;
  std::size_t frames = 0;
  std::size_t repeats = 0;            ///< frames that two of them have, with the same bytes
  std::vector<std::string> problems;  ///< one line each
};

/// Makes one session's folder of what several servers have of it, with a journal and views of its
/// own: each frame that any of them has, once, but for images that a power cut took; what was named
/// and what other streams had; of the one that got furthest, how the session was left. Images are
/// hard links where that is possible, else copies. `out` must not be there, or be empty. Of a frame
/// that one of them has reduced and another one whole the whole one is taken; any other frame of
/// which two have different bytes is a problem, and the one of the folder that got further is
/// taken. Blocking; reentrant.
Result<JoinReport> join_session(const std::vector<std::filesystem::path>& folders,
                                const std::filesystem::path& out);

}  // namespace orbbuf

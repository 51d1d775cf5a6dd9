// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>

#include "testing/source_folder.hpp"

namespace orbbuf::test {

/// What `action` throws as std::runtime_error; empty if nothing.
template <class Action>
std::string error_of(const Action& action) {
  try {
    action();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return {};
}

/// A recorded sequence outside of the repository, which may be absent.
inline std::filesystem::path real_sequence(std::string_view name) {
  return std::filesystem::path(test::kSourceFolder) / ".." / "shared" / "data" / "sequences" / name;
}

}  // namespace orbbuf::test

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <set>
#include <string>
#include <string_view>

namespace orbbuf {

/// The word that `word` may be a slip of: the nearest of `words` by Levenshtein distance, the first
/// of equals, if at most one letter in four (and never fewer than two) would have to change.
std::optional<std::string> nearest_word(std::string_view word, const std::set<std::string>& words);

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/crop.hpp"

#include <fmt/core.h>

#include <charconv>

namespace orbbuf {
namespace {

constexpr int kTooLarge = 100'000;

/// Takes a number off the front of `text`, and `after` behind it, if not 0.
bool take(std::string_view& text, int& number, char after) {
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, number);
  if (error != std::errc() || number < 0 || number >= kTooLarge) return false;
  text.remove_prefix(static_cast<std::size_t>(rest - text.data()));
  if (after == 0) return text.empty();
  if (!text.starts_with(after)) return false;
  text.remove_prefix(1);
  return true;
}

}  // namespace

std::optional<Crop> parse_crop(std::string_view text) {
  Crop crop;
  const bool is_read = take(text, crop.width_px, 'x') && take(text, crop.height_px, '+') &&
                       take(text, crop.left_px, '+') && take(text, crop.top_px, 0);
  if (!is_read || crop.width_px == 0 || crop.height_px == 0) return std::nullopt;
  return crop;
}

std::string to_string(const Crop& crop) {
  return fmt::format("{}x{}+{}+{}", crop.width_px, crop.height_px, crop.left_px, crop.top_px);
}

}  // namespace orbbuf

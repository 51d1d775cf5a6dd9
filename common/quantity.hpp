// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace orbbuf {

/// A decimal number and one of ns, us, ms, s, min, h, with or without a blank between them:
/// "1.5 s", "-20ms". Nothing if `text` is not that, or not below 292 years.
std::optional<std::chrono::nanoseconds> parse_duration(std::string_view text);

/// A decimal number, not negative, and one of B, KiB, MiB, GiB, TiB. Nothing if `text` is not that,
/// or not below 8 EiB. Exact up to 8 PiB.
std::optional<std::uint64_t> parse_bytes(std::string_view text);

/// In the largest unit that needs no fraction: "1500 ms", "2 min", "0 s".
std::string format_duration(std::chrono::nanoseconds duration);
std::string format_bytes(std::uint64_t bytes);

}  // namespace orbbuf

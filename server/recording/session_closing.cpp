// SPDX-License-Identifier: Apache-2.0
#include "server/recording/session_closing.hpp"

#include <spdlog/fmt/fmt.h>

#include <array>

#include "common/decimal.hpp"

namespace orbbuf {
namespace {

constexpr std::string_view kHeader = "state,captured,skipped,failed,dropped,acknowledged\n";
constexpr std::string_view kEnded = "ended,";
constexpr std::string_view kOpen = "open,";
constexpr std::string_view kUnknown = ",,,,\n";

}  // namespace

std::string to_csv(const SessionClosing& closing) {
  std::string text(kHeader);
  text += closing.has_ended ? kEnded : kOpen;
  if (!closing.stats) return text.append(kUnknown);
  const wire::Stats& stats = *closing.stats;
  return text + fmt::format("{},{},{},{},{}\n", stats.captured, stats.skipped, stats.failed,
                            stats.dropped, stats.acknowledged);
}

std::optional<SessionClosing> closing_from_csv(std::string_view text) {
  if (!text.starts_with(kHeader)) return std::nullopt;
  text.remove_prefix(kHeader.size());
  SessionClosing closing;
  closing.has_ended = text.starts_with(kEnded);
  if (!closing.has_ended && !text.starts_with(kOpen)) return std::nullopt;
  text.remove_prefix(text.find(',') + 1);
  if (text == kUnknown) return closing;
  wire::Stats stats;
  const std::array fields{&stats.captured, &stats.skipped, &stats.failed, &stats.dropped,
                          &stats.acknowledged};
  for (std::uint64_t* field : fields) {
    const auto end = text.find_first_of(",\n");
    if (end == std::string_view::npos) return std::nullopt;
    const auto number = parse_digits(text.substr(0, end));
    const bool is_last = field == fields.back();
    if (!number || (text[end] == '\n') != is_last) return std::nullopt;
    *field = *number;
    text.remove_prefix(end + 1);
  }
  if (!text.empty()) return std::nullopt;
  closing.stats = stats;
  return closing;
}

}  // namespace orbbuf

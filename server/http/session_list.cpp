// SPDX-License-Identifier: Apache-2.0
#include "server/http/session_list.hpp"

#include <spdlog/fmt/fmt.h>

#include <set>
#include <string_view>
#include <system_error>

#include "common/wire.hpp"
#include "server/recording/session_names.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostNames = 1000;

}  // namespace

std::optional<std::string> folders_json(const fs::path& folder) {
  std::error_code failed;
  std::set<std::string, std::greater<>> names;
  fs::directory_iterator entry(folder, failed);
  for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    std::string name = entry->path().filename().string();
    std::error_code gone;
    if (!wire::is_valid_id(name) || !entry->is_directory(gone)) continue;
    names.insert(std::move(name));
    if (names.size() > kMostNames) names.erase(std::prev(names.end()));
  }
  if (failed) return std::nullopt;
  std::string json = R"({"names":[)";
  for (const std::string& name : names) {
    json += fmt::format("{}\"{}\"", json.back() == '[' ? "" : ",", name);
  }
  return json + "]}\n";
}

std::optional<std::string> session_json(const fs::path& folder) {
  std::error_code failed;
  if (!fs::is_directory(folder, failed)) return std::nullopt;
  const auto size_of = [&](std::string_view name) {
    std::error_code absent;
    const auto bytes = fs::file_size(folder / name, absent);
    return absent ? std::string("null") : std::to_string(bytes);
  };
  return fmt::format(R"({{"times":{},"drops":{},"calibration":{}}})"
                     "\n",
                     size_of(session_names::kTimes), size_of(session_names::kDrops),
                     size_of(session_names::kCamera));
}

}  // namespace orbbuf

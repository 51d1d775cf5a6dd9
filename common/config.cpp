// SPDX-License-Identifier: Apache-2.0
#include "common/config.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/config_source.hpp"
#include "common/quantity.hpp"

namespace orbbuf {
namespace {

void require_range(bool is_inside, const Setting& setting, std::string_view key,
                   std::string_view min, std::string_view max, std::string_view got) {
  if (is_inside) return;
  refuse(setting.where, key, fmt::format("must be between {} and {}, got {}", min, max, got));
}

const std::string& string_of(const Setting& setting, std::string_view key,
                             std::string_view expected) {
  const auto* const value = setting.node->as_string();
  if (value == nullptr) refuse_type(setting, key, expected);
  return value->get();
}

std::vector<std::string> strings_of(const Setting& setting, std::string_view key,
                                    std::string_view expected) {
  const auto* const array = setting.node->as_array();
  if (array == nullptr) refuse_type(setting, key, expected);
  std::vector<std::string> got;
  for (const toml::node& element : *array) {
    got.push_back(string_of({&element, setting.where, false}, key, expected));
  }
  return got;
}

}  // namespace

struct ConfigReader::State : ConfigSource {
  using ConfigSource::ConfigSource;
};

ConfigReader::ConfigReader(const std::filesystem::path& file,
                           std::span<const std::string> overrides)
    : state_(std::make_unique<State>(file, overrides)) {}

ConfigReader::~ConfigReader() = default;

bool ConfigReader::has(std::string_view key) const { return state_->locate(key).has_value(); }

std::string ConfigReader::text(std::string_view key, std::string_view fallback) {
  const auto setting = state_->ask(key);
  if (!setting) return std::string(fallback);
  // There are no quotation marks in `--set source.camera=0`.
  if (setting->is_override && setting->node->is_integer()) {
    return setting->where.substr(setting->where.find('=') + 1);
  }
  return string_of(*setting, key, "a string");
}

std::vector<std::string> ConfigReader::texts(std::string_view key) {
  constexpr std::string_view kExpected = "an array of strings";
  const auto setting = state_->ask(key);
  if (!setting) return {};
  if (setting->is_override && setting->node->is_string()) {
    return {string_of(*setting, key, kExpected)};
  }
  return strings_of(*setting, key, kExpected);
}

std::vector<std::string> ConfigReader::one_or_more_texts(std::string_view key,
                                                         const std::vector<std::string>& fallback) {
  constexpr std::string_view kExpected = "a string or an array of strings";
  const auto setting = state_->ask(key);
  if (!setting) return fallback;
  if (setting->node->is_string()) return {string_of(*setting, key, kExpected)};
  return strings_of(*setting, key, kExpected);
}

bool ConfigReader::flag(std::string_view key, bool fallback) {
  const auto setting = state_->ask(key);
  if (!setting) return fallback;
  const auto* const value = setting->node->as_boolean();
  if (value == nullptr) refuse_type(*setting, key, "true or false");
  return value->get();
}

std::int64_t ConfigReader::integer(std::string_view key, std::int64_t fallback, std::int64_t min,
                                   std::int64_t max) {
  const auto setting = state_->ask(key);
  if (!setting) return fallback;
  const auto* const value = setting->node->as_integer();
  if (value == nullptr) refuse_type(*setting, key, "an integer");
  const std::int64_t got = value->get();
  require_range(got >= min && got <= max, *setting, key, fmt::to_string(min), fmt::to_string(max),
                fmt::to_string(got));
  return got;
}

double ConfigReader::number(std::string_view key, double fallback, double min, double max) {
  const auto setting = state_->ask(key);
  if (!setting) return fallback;
  if (!setting->node->is_number()) refuse_type(*setting, key, "a number");
  const double got = *setting->node->value<double>();
  require_range(std::isfinite(got) && got >= min && got <= max, *setting, key, fmt::to_string(min),
                fmt::to_string(max), fmt::to_string(got));
  return got;
}

std::chrono::nanoseconds ConfigReader::duration(std::string_view key,
                                                std::chrono::nanoseconds fallback,
                                                std::chrono::nanoseconds min,
                                                std::chrono::nanoseconds max) {
  constexpr std::string_view kExpected = "a duration such as \"500 ms\"";
  const auto setting = state_->ask(key);
  if (!setting) return fallback;
  const std::string& text = string_of(*setting, key, kExpected);
  const auto got = parse_duration(text);
  if (!got) refuse_type(*setting, key, kExpected);
  require_range(*got >= min && *got <= max, *setting, key, format_duration(min),
                format_duration(max), quoted(text));
  return *got;
}

std::uint64_t ConfigReader::bytes(std::string_view key, std::uint64_t fallback, std::uint64_t min,
                                  std::uint64_t max) {
  constexpr std::string_view kExpected = "a size such as \"16 KiB\"";
  const auto setting = state_->ask(key);
  if (!setting) return fallback;
  const std::string& text = string_of(*setting, key, kExpected);
  const auto got = parse_bytes(text);
  if (!got) refuse_type(*setting, key, kExpected);
  require_range(*got >= min && *got <= max, *setting, key, format_bytes(min), format_bytes(max),
                quoted(text));
  return *got;
}

std::string ConfigReader::choice(std::string_view key, std::string_view fallback,
                                 std::span<const std::string_view> allowed) {
  const auto setting = state_->ask(key);
  if (!setting) return std::string(fallback);
  const std::string expected = fmt::format("one of {}", fmt::join(allowed, ", "));
  const std::string& got = string_of(*setting, key, expected);
  if (std::find(allowed.begin(), allowed.end(), got) == allowed.end()) {
    refuse_type(*setting, key, expected);
  }
  return got;
}

std::filesystem::path ConfigReader::path(std::string_view key,
                                         const std::filesystem::path& fallback) {
  const auto setting = state_->ask(key);
  if (!setting) return fallback;
  std::filesystem::path got = string_of(*setting, key, "a path");
  if (got.empty() || setting->is_override) return got;
  return state_->file().parent_path() / got;  // `got` itself, if it is absolute
}

std::map<std::string, double> ConfigReader::numbers(std::string_view key) {
  std::map<std::string, double> values;
  for (const std::string& name : state_->ask_table(key)) {
    const std::string path = fmt::format("{}.{}", key, path_step(name));
    const auto setting = state_->ask(path);
    if (!setting) continue;
    if (const auto number = setting->node->value<double>();
        number && setting->node->is_number() && std::isfinite(*number)) {
      values[name] = *number;
    } else if (const auto* const flag = setting->node->as_boolean()) {
      values[name] = flag->get() ? 1 : 0;
    } else {
      refuse_type(*setting, path, "a number");
    }
  }
  return values;
}

std::map<std::string, std::string> ConfigReader::tables(std::string_view key) {
  std::map<std::string, std::string> tables;
  for (const std::string& name : state_->ask_table(key)) {
    tables[name] = fmt::format("{}.{}", key, path_step(name));
  }
  return tables;
}

void ConfigReader::reject_unknown() const { state_->reject_unknown(); }

void ConfigReader::fail(std::string_view key, std::string_view why) const {
  const auto setting = state_->locate(key);
  if (setting) refuse(setting->where, key, why);
  if (!state_->file().empty()) refuse(state_->file().string(), key, why);
  throw ConfigError(fmt::format("{}: {}", key, why));
}

}  // namespace orbbuf

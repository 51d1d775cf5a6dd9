// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <concepts>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace orbbuf {

/// An error in the configuration: `FILE:LINE: KEY: why`, or `--set KEY=VALUE: KEY: why`. Always one
/// line: control characters in `text` become '?'.
class ConfigError : public std::runtime_error {
 public:
  explicit ConfigError(std::string text);
};

/// Typed reading of one TOML file, toml++ hidden behind it. A key is `table.key`. Every getter
/// names the key's default. reject_unknown(), after the last getter, refuses every key that no
/// getter asked for. All members throw ConfigError. Start-up only; reentrant.
class ConfigReader {
 public:
  /// Reads `file` (empty: no file, all defaults) and applies `overrides`, each
  /// `table.key=value`. An override's value is TOML; what is not valid TOML is taken as a string,
  /// so that `link.server=10.0.0.1:7722` needs no quotes.
  ConfigReader(const std::filesystem::path& file, std::span<const std::string> overrides);
  ~ConfigReader();
  ConfigReader(const ConfigReader&) = delete;
  ConfigReader& operator=(const ConfigReader&) = delete;

  /// Whether `key` is set, to a value of any type.
  bool has(std::string_view key) const;

  std::string text(std::string_view key, std::string_view fallback);
  /// An array of strings; none by default. An override may be one bare word.
  std::vector<std::string> texts(std::string_view key);
  /// A string, or an array of strings.
  std::vector<std::string> one_or_more_texts(std::string_view key,
                                             const std::vector<std::string>& fallback);
  bool flag(std::string_view key, bool fallback);
  std::int64_t integer(std::string_view key, std::int64_t fallback, std::int64_t min,
                       std::int64_t max);
  /// Integers are accepted as well.
  double number(std::string_view key, double fallback, double min, double max);
  /// A string with a unit: "250 ms", "1.5 s", "2 min", "1 h" (also us and ns; the blank may be left
  /// out).
  std::chrono::nanoseconds duration(std::string_view key, std::chrono::nanoseconds fallback,
                                    std::chrono::nanoseconds min, std::chrono::nanoseconds max);
  /// A string with a unit: "16 KiB", "4 MiB", "1 GiB", "512 B".
  std::uint64_t bytes(std::string_view key, std::uint64_t fallback, std::uint64_t min,
                      std::uint64_t max);
  /// One of `allowed`; the error lists them all.
  std::string choice(std::string_view key, std::string_view fallback,
                     std::span<const std::string_view> allowed);
  /// A path; a relative one is taken from the folder of the configuration file (from the working
  /// directory for `--set` and without a file). Empty stays empty.
  std::filesystem::path path(std::string_view key, const std::filesystem::path& fallback);

  /// The same for a variable: its value is the default before, and what was read afterwards.
  void read(std::string_view key, std::string& value) { value = text(key, value); }
  void read(std::string_view key, std::filesystem::path& value) { value = path(key, value); }
  void read(std::string_view key, bool& value) { value = flag(key, value); }
  void read(std::string_view key, double& value, double min, double max) {
    value = number(key, value, min, max);
  }
  void read(std::string_view key, std::chrono::nanoseconds& value, std::chrono::nanoseconds min,
            std::chrono::nanoseconds max) {
    value = duration(key, value, min, max);
  }
  void read(std::string_view key, std::string& value, std::span<const std::string_view> allowed) {
    value = choice(key, value, allowed);
  }
  template <std::integral Integer>
  void read(std::string_view key, Integer& value, std::int64_t min, std::int64_t max) {
    value = static_cast<Integer>(integer(key, static_cast<std::int64_t>(value), min, max));
  }
  template <std::integral Integer>
  void read_bytes(std::string_view key, Integer& value, std::uint64_t min, std::uint64_t max) {
    value = static_cast<Integer>(bytes(key, value, min, max));
  }

  /// A table with keys of the user's choice and a number for each; true and false are 1 and 0.
  /// `--set KEY.NAME=VALUE` adds to the file's.
  std::map<std::string, double> numbers(std::string_view key);

  /// The tables within the table `key`, with names of the user's choice: name -> the full key of
  /// that table, for the getters. `--set KEY.NAME.REST=VALUE` adds to the file's. A name that is no
  /// bare word is in quotes there, KEY."NAME".
  std::map<std::string, std::string> tables(std::string_view key);

  /// Names the first key that no getter asked for, with the nearest known key if one is near.
  void reject_unknown() const;
  /// Throws for the value of `key`, naming where it was set (the file if it was not set).
  [[noreturn]] void fail(std::string_view key, std::string_view why) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace orbbuf

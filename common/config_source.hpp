// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <toml++/toml.h>

#include <filesystem>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// The implementation of ConfigReader, for config*.cpp only: what is set, where, and which keys
/// are known.
namespace orbbuf {

/// A value and where it was set: `FILE:LINE` or `--set KEY=VALUE`.
struct Setting {
  const toml::node* node = nullptr;
  std::string where;
  bool is_override = false;
};

/// One file and the overrides of its values. Lends its nodes: it must outlive every Setting.
class ConfigSource {
 public:
  ConfigSource(std::filesystem::path file, std::span<const std::string> overrides);

  const std::filesystem::path& file() const { return file_; }

  /// What is set at `key`, the last override first, if anything. Throws ConfigError where `key`
  /// needs a table and the file has something else.
  std::optional<Setting> locate(std::string_view key) const;

  /// locate(), and marks `key` as known.
  std::optional<Setting> ask(std::string_view key);

  /// The names set in the table `key`, of the file and of overrides. Marks `key` as known.
  std::set<std::string> ask_table(std::string_view key);

  /// Throws ConfigError for the first key or table, in the order of the lines and then of the
  /// overrides, that no getter asked for.
  void reject_unknown() const;

 private:
  struct Override {
    std::string key;
    std::string argument;  // KEY=VALUE, as given
    toml::table holder;    // the value, at kHeld
  };
  struct Stranger {
    toml::source_position position;
    std::string path;
    bool is_table = false;
  };

  static Override parse_override(const std::string& argument);
  Setting setting_of(const toml::node& node) const;
  std::string place(toml::source_position position) const;
  void look_for_strangers(const toml::table& table, const std::string& prefix,
                          std::optional<Stranger>& first) const;

  std::filesystem::path file_;  // empty: none
  toml::table root_;
  std::vector<Override> overrides_;
  std::set<std::string> known_keys_;
  std::set<std::string> known_tables_;
};

/// `text` in quotes.
std::string quoted(const std::string& text);

/// `name` as one step of a key: in quotes if it is no bare word.
std::string path_step(std::string_view name);

/// Throw ConfigError: `WHERE: KEY: why`, and `WHERE: KEY: expected ..., got ...`.
[[noreturn]] void refuse(std::string_view where, std::string_view key, std::string_view why);
[[noreturn]] void refuse_type(const Setting& setting, std::string_view key,
                              std::string_view expected);

/// The word that `word` may be a slip of: the nearest of `words` by Levenshtein distance, the first
/// of equals, if at most one letter in four (and never fewer than two) would have to change.
std::optional<std::string> nearest_word(std::string_view word, const std::set<std::string>& words);

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#include "common/config_source.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <numeric>
#include <utility>

#include "common/config.hpp"
#include "common/file_io.hpp"

namespace orbbuf {
namespace {

constexpr std::string_view kHeld = "v";

toml::table parse_file(const std::filesystem::path& path) {
  const auto content = read_file(path);
  if (!content) throw ConfigError("cannot " + content.error().text);
  const std::string_view text(reinterpret_cast<const char*>(content.value().data()),
                              content.value().size());
  try {
    return toml::parse(text, path.string());
  } catch (const toml::parse_error& error) {
    throw ConfigError(
        fmt::format("{}:{}: {}", path.string(), error.source().begin.line, error.description()));
  }
}

/// As TOML if it is one TOML value and nothing else. The inline table sees to "nothing else": a
/// line end, a comment or a second value does not fit into its place.
toml::table parse_value(const std::string& value) {
  try {
    toml::table root = toml::parse(fmt::format("t = {{{} = {}}}", kHeld, value));
    toml::table* const holder = root["t"].as_table();
    if (root.size() == 1 && holder != nullptr && holder->size() == 1) return std::move(*holder);
  } catch (const toml::parse_error&) {
    // Not TOML, so a string without its quotes.
  }
  return toml::table{{kHeld, value}};
}

std::string describe(const toml::node& node) {
  if (const auto* value = node.as_string()) return "string " + quoted(value->get());
  if (const auto* value = node.as_integer()) return fmt::format("integer {}", value->get());
  if (const auto* value = node.as_floating_point()) return fmt::format("number {}", value->get());
  if (const auto* value = node.as_boolean()) return fmt::format("boolean {}", value->get());
  if (node.is_table()) return "a table";
  return node.is_array() ? "an array" : "a date or time";
}

/// Where the step of `key` that begins at `begin` ends: at the next dot that is not in quotes.
std::size_t step_end(std::string_view key, std::size_t begin) {
  std::size_t end = begin;
  if (begin < key.size() && key[begin] == '"') end = std::min(key.find('"', begin + 1), key.size());
  return std::min(key.find('.', end), key.size());
}

/// The name that a step of a key stands for.
std::string_view step_name(std::string_view step) {
  const bool is_quoted = step.size() > 1 && step.front() == '"' && step.back() == '"';
  return is_quoted ? step.substr(1, step.size() - 2) : step;
}

[[noreturn]] void refuse_unknown(std::string_view where, std::string_view path,
                                 std::string_view what, const std::set<std::string>& known) {
  const auto nearest = nearest_word(path, known);
  refuse(where, path,
         nearest ? fmt::format("unknown {}; did you mean '{}'?", what, *nearest)
                 : fmt::format("unknown {}", what));
}

std::string on_one_line(std::string text) {
  const auto is_control = [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; };
  std::replace_if(text.begin(), text.end(), is_control, '?');
  return text;
}

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);  // distances of a[0 .. i) from each beginning of b
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

}  // namespace

std::optional<std::string> nearest_word(std::string_view word, const std::set<std::string>& words) {
  std::optional<std::string> nearest;
  std::size_t best = std::max<std::size_t>(2, word.size() / 4) + 1;
  for (const std::string& candidate : words) {
    const std::size_t distance = edit_distance(word, candidate);
    if (distance >= best) continue;
    best = distance;
    nearest = candidate;
  }
  return nearest;
}

ConfigError::ConfigError(std::string text) : std::runtime_error(on_one_line(std::move(text))) {}

ConfigSource::ConfigSource(std::filesystem::path file, std::span<const std::string> overrides)
    : file_(std::move(file)) {
  if (!file_.empty()) root_ = parse_file(file_);
  for (const std::string& argument : overrides) overrides_.push_back(parse_override(argument));
}

ConfigSource::Override ConfigSource::parse_override(const std::string& argument) {
  const std::size_t equals = argument.find('=');
  if (equals == std::string::npos) {
    throw ConfigError("--set " + argument + ": expected KEY=VALUE");
  }
  if (equals == 0) throw ConfigError("--set " + argument + ": the key is empty");
  return {argument.substr(0, equals), argument, parse_value(argument.substr(equals + 1))};
}

std::optional<Setting> ConfigSource::locate(std::string_view key) const {
  const auto last = std::find_if(overrides_.rbegin(), overrides_.rend(),
                                 [&](const Override& entry) { return entry.key == key; });
  if (last != overrides_.rend()) {
    return Setting{last->holder.get(kHeld), "--set " + last->argument, true};
  }
  const toml::node* node = &root_;
  for (std::size_t begin = 0; begin <= key.size();) {
    const std::size_t end = step_end(key, begin);
    const toml::table* const table = node->as_table();
    if (table == nullptr) refuse_type(setting_of(*node), key.substr(0, begin - 1), "a table");
    node = table->get(step_name(key.substr(begin, end - begin)));
    if (node == nullptr) return std::nullopt;
    begin = end + 1;
  }
  return setting_of(*node);
}

std::optional<Setting> ConfigSource::ask(std::string_view key) {
  known_keys_.emplace(key);
  for (auto dot = step_end(key, 0); dot < key.size(); dot = step_end(key, dot + 1)) {
    known_tables_.emplace(key.substr(0, dot));
  }
  return locate(key);
}

std::set<std::string> ConfigSource::ask_table(std::string_view key) {
  std::set<std::string> names;
  known_tables_.emplace(key);
  if (const auto setting = locate(key)) {
    const auto* const table = setting->node->as_table();
    if (table == nullptr || setting->is_override) refuse_type(*setting, key, "a table in the file");
    for (const auto& [name, value] : *table) names.emplace(name.str());
  }
  const std::string prefix = std::string(key) + '.';
  for (const Override& entry : overrides_) {
    if (!entry.key.starts_with(prefix)) continue;
    const std::string_view rest = std::string_view(entry.key).substr(prefix.size());
    names.emplace(step_name(rest.substr(0, step_end(rest, 0))));
  }
  return names;
}

void ConfigSource::reject_unknown() const {
  std::optional<Stranger> first;
  look_for_strangers(root_, "", first);
  if (first && first->is_table) {
    refuse_unknown(place(first->position), first->path, "table", known_tables_);
  }
  if (first) refuse_unknown(place(first->position), first->path, "key", known_keys_);
  for (const Override& entry : overrides_) {
    if (known_keys_.contains(entry.key)) continue;
    refuse_unknown("--set " + entry.argument, entry.key, "key", known_keys_);
  }
}

Setting ConfigSource::setting_of(const toml::node& node) const {
  return {&node, place(node.source().begin), false};
}

std::string ConfigSource::place(toml::source_position position) const {
  return fmt::format("{}:{}", file_.string(), position.line);
}

/// Leaves the earliest stranger of `table`, whose keys begin with `prefix`, in `first`.
void ConfigSource::look_for_strangers(const toml::table& table, const std::string& prefix,
                                      std::optional<Stranger>& first) const {
  for (const auto& [key, node] : table) {
    const std::string path = prefix + path_step(key.str());
    if (known_keys_.contains(path)) continue;
    if (node.is_table() && known_tables_.contains(path)) {
      look_for_strangers(*node.as_table(), path + ".", first);
    } else if (!first || key.source().begin < first->position) {
      first = Stranger{key.source().begin, path, node.is_table()};
    }
  }
}

std::string quoted(const std::string& text) { return fmt::format("\"{}\"", text); }

std::string path_step(std::string_view name) {
  const auto is_bare = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-';
  };
  const bool is_word = !name.empty() && std::all_of(name.begin(), name.end(), is_bare);
  return is_word ? std::string(name) : quoted(std::string(name));
}

void refuse(std::string_view where, std::string_view key, std::string_view why) {
  throw ConfigError(fmt::format("{}: {}: {}", where, key, why));
}

void refuse_type(const Setting& setting, std::string_view key, std::string_view expected) {
  refuse(setting.where, key, fmt::format("expected {}, got {}", expected, describe(*setting.node)));
}

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
// The manual pages and the completion tell of every key, with its default, and of every option.
#include <gtest/gtest.h>

#include <algorithm>
#include <iterator>
#include <regex>
#include <set>

#include "testing/source_folder.hpp"
#include "tests/e2e/programs.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

const std::string kSource = kSourceFolder + std::string("/");

/// `table.key` and the default, as the sample has them.
std::vector<std::pair<std::string, std::string>> keys_of(const std::string& sample) {
  static const std::regex kTable(R"(^\[(\w+)\])");
  static const std::regex kKey(R"(^(\w+) = ("[^"]*"|[^#]*[^# ]))");
  std::vector<std::pair<std::string, std::string>> keys;
  std::string table;
  for (const std::string& line : read_lines(sample)) {
    std::smatch match;
    if (std::regex_search(line, match, kTable)) {
      table = match[1];
    } else if (std::regex_search(line, match, kKey)) {
      keys.emplace_back(table + "." + match[1].str(), match[2]);
    }
  }
  return keys;
}

std::string in_mdoc(const std::string& value) {
  return std::regex_replace(value, std::regex("\""), "\\(dq");
}

struct Program {
  const char* name;
  const char* path;
  std::size_t keys;  // at least: that they are found at all
};

/// Of a program and of its subcommands.
std::set<std::string> options_of(const std::string& program) {
  static const std::regex kOption(R"(\n  (?:-h,)?--([a-z-]+))");
  static const std::regex kSubcommand(R"(\n  ([a-z-]+) )");
  const std::string help = run({program, "--help"}).output;
  std::set<std::string> options;
  const auto add = [&](const std::string& text) {
    for (std::sregex_iterator at(text.begin(), text.end(), kOption), end; at != end; ++at) {
      options.insert((*at)[1]);
    }
  };
  add(help);
  const auto subcommands = help.substr(std::min(help.find("\nSubcommands:"), help.size()));
  for (std::sregex_iterator at(subcommands.begin(), subcommands.end(), kSubcommand), end; at != end;
       ++at) {
    add(run({program, (*at)[1], "--help"}).output);
  }
  return options;
}

class ManualTest : public ::testing::TestWithParam<Program> {};

TEST_P(ManualTest, TellsOfEveryKeyWithItsDefaultAndOfNoOther) {
  const std::string name = GetParam().name;
  const auto keys = keys_of(kSource + "config/" + name + ".toml");
  EXPECT_GE(keys.size(), GetParam().keys);
  const auto page = read_lines(kSource + "docs/man/" + name + ".toml.5");
  for (const auto& [key, value] : keys) {
    const std::string item = ".It Ic " + key + " No = " + in_mdoc(value);
    EXPECT_EQ(std::count(page.begin(), page.end(), item), 1) << item;
  }
  const auto items = std::count_if(page.begin(), page.end(), [](const std::string& line) {
    return line.starts_with(".It Ic ");
  });
  EXPECT_EQ(static_cast<std::size_t>(items), keys.size());
}

TEST_P(ManualTest, AndTheCompletionTellOfEveryOptionAndOfNoOther) {
  const std::string name = GetParam().name;
  const std::string page = read_file(kSource + "docs/man/" + name + ".8");
  const std::string completion =
      read_file(kBuildFolder + std::string("/docs/man/") + name + ".completion");
  const std::set<std::string> options = options_of(GetParam().path);
  for (const std::string& option : options) {
    EXPECT_TRUE(std::regex_search(page, std::regex("\n\\.It .*Fl -" + option + "( |\n)")))
        << option;
    EXPECT_TRUE(std::regex_search(completion, std::regex("[ ']--" + option + "[ ']"))) << option;
  }
  EXPECT_GE(options.size(), 5U);
  const auto count = [](const std::string& text, const std::string& what) {
    const std::regex pattern(what);
    return static_cast<std::size_t>(
        std::distance(std::sregex_iterator(text.begin(), text.end(), pattern), {}));
  };
  EXPECT_EQ(count(page, "\n\\.It .*Fl -[a-z]"), options.size());
  EXPECT_EQ(count(completion, "[ ']--[a-z-]+(?=[ '])"), options.size());
}

TEST(Changelog, BeginsWithThisVersion) {
  const auto lines = read_lines(kSource + "CHANGELOG.md");
  const auto heading = std::find_if(lines.begin(), lines.end(),
                                    [](const auto& line) { return line.starts_with("## "); });
  ASSERT_NE(heading, lines.end());
  EXPECT_TRUE(heading->starts_with("## " ORBBUF_VERSION " (")) << *heading;
}

INSTANTIATE_TEST_SUITE_P(Programs, ManualTest,
                         ::testing::Values(Program{"orbbufd", kOrbbufd, 30},
                                           Program{"orbbuf-server", kOrbbufServer, 20}),
                         [](const auto& program) {
                           return std::string(program.index == 0 ? "orbbufd" : "server");
                         });

}  // namespace
}  // namespace orbbuf::test

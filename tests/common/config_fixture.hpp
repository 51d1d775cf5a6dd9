// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "common/config.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf {

/// One configuration file at a time. In the texts of errors its name is FILE.
class ConfigFixture : public testing::Test {
 protected:
  std::filesystem::path file() const { return folder_ / "robot.toml"; }

  ConfigReader read(std::string_view content, const std::vector<std::string>& overrides = {}) {
    test::write_file(file(), std::string(content));
    return {file(), overrides};
  }

  /// The text of the ConfigError that `attempt` throws; empty if it throws none.
  template <class Attempt>
  std::string error_of(Attempt attempt) const {
    try {
      attempt();
    } catch (const ConfigError& error) {
      std::string text = error.what();
      const std::string name = file().string();
      if (const auto at = text.find(name); at != std::string::npos) {
        text.replace(at, name.size(), "FILE");
      }
      return text;
    }
    return "";
  }

  /// Does `use` with a reader of a table `t` whose second line is `line`.
  template <class Use>
  std::string error_with(std::string_view line, Use use,
                         const std::vector<std::string>& overrides = {}) {
    return error_of([&] {
      auto reader = read("[t]\n" + std::string(line) + "\n", overrides);
      use(reader);
    });
  }

 private:
  test::TemporaryFolder folder_;
};

}  // namespace orbbuf

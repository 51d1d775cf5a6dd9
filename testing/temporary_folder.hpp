// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace orbbuf::test {

/// A new folder, removed with all its content at the end of its life.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

/// The whole content of a file; empty if it cannot be read.
std::string read_file(const std::filesystem::path& path);

/// The lines of a text file, without their ends.
std::vector<std::string> read_lines(const std::filesystem::path& path);

void write_file(const std::filesystem::path& path, const std::string& content);

}  // namespace orbbuf::test

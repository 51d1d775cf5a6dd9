// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fcntl.h>
#include <sys/stat.h>

#include <array>
#include <bit>
#include <cstdint>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "common/unique_fd.hpp"
#include "daemon/samples/iio_device.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf::test {

/// What the kernel shows of devices of IIO, as files in a temporary folder; a node is a FIFO.
class IioTree {
 public:
  const IioRoots& roots() const { return roots_; }

  /// Files of iio:deviceNUMBER, by their paths.
  void add(int number, const std::map<std::string, std::string>& files) {
    for (const auto& [path, text] : files) put(number, path, text);
    std::filesystem::create_directories(roots_.nodes);
    ::mkfifo((roots_.nodes / name_of(number)).c_str(), S_IRUSR | S_IWUSR);
  }
  void put(int number, const std::string& path, const std::string& text) {
    const auto file = roots_.devices / name_of(number) / path;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file) << text << '\n';
  }
  std::string get(int number, const std::string& path) const {
    std::string text;
    std::getline(std::ifstream(roots_.devices / name_of(number) / path), text);
    return text;
  }
  /// For the test to write to, and so that a reader meets no end.
  UniqueFd open_node(int number) const {
    return UniqueFd(::open((roots_.nodes / name_of(number)).c_str(), O_RDWR | O_CLOEXEC));
  }

  /// x, y and z of 16 bits, from the index on.
  static void add_sensor(std::map<std::string, std::string>& files, const std::string& type,
                         int index, const std::string& scale) {
    for (const char* const axis : {"x", "y", "z"}) {
      const std::string element = "scan_elements/in_" + type + "_" + axis;
      files[element + "_en"] = "0";
      files[element + "_index"] = std::to_string(index++);
      files[element + "_type"] = "be:s16/16>>0";
    }
    files["in_" + type + "_scale"] = scale;
  }
  /// A buffer that is off, with stamps behind all else.
  static std::map<std::string, std::string> device(const std::string& name) {
    return {{"name", name},
            {"current_timestamp_clock", "realtime"},
            {"buffer/enable", "0"},
            {"buffer/length", "2"},
            {"scan_elements/in_timestamp_en", "0"},
            {"scan_elements/in_timestamp_index", "9"},
            {"scan_elements/in_timestamp_type", "le:s64/64>>0"}};
  }
  /// Words of 16 bits, big end first, and the stamp at the next multiple of 8.
  static std::vector<std::uint8_t> scan(const std::vector<int>& words, std::int64_t stamp) {
    std::vector<std::uint8_t> bytes;
    for (const int word : words) {
      bytes.push_back(static_cast<std::uint8_t>(word >> 8));
      bytes.push_back(static_cast<std::uint8_t>(word & 0xFF));
    }
    bytes.resize((bytes.size() + 7) / 8 * 8);
    for (unsigned i = 0; i < 8; ++i) bytes.push_back(static_cast<std::uint8_t>(stamp >> 8 * i));
    return bytes;
  }

 private:
  static std::string name_of(int number) { return "iio:device" + std::to_string(number); }

  const TemporaryFolder folder_;
  const IioRoots roots_{folder_ / "devices", folder_ / "nodes"};
};

}  // namespace orbbuf::test

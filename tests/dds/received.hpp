// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <utility>

/// What a reader received, for run.sh to compare: FOLDER/BASE/SECONDS.jpg of each image,
/// SECONDS.raw of each raw one, SECONDS.info of each camera_info. Says `receiving TOPIC` at a
/// topic's first message. One thread.
class Received {
 public:
  explicit Received(std::filesystem::path folder) : folder_(std::move(folder)) {}

  void expect(const std::string& base) { std::filesystem::create_directories(folder_ / base); }

  void keep(const std::string& base, std::int32_t sec, std::uint32_t nanosec,
            const std::string& suffix, const void* data, std::size_t bytes) {
    char stamp[32];
    std::snprintf(stamp, sizeof stamp, "%d.%09u", sec, nanosec);
    const auto incoming = folder_ / "incoming";  // whole at once: run.sh looks at any time
    std::ofstream(incoming, std::ios::binary)
        .write(static_cast<const char*>(data), static_cast<std::streamsize>(bytes));
    std::filesystem::rename(incoming, folder_ / base / (stamp + suffix));
    if (!said_.insert(base + suffix).second) return;
    std::printf("receiving %s %s\n", base.c_str(), suffix.c_str());
    std::fflush(stdout);
  }

 private:
  std::filesystem::path folder_;
  std::set<std::string> said_;
};

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace orbbuf::bench {

/// A file system that can lose power: ext4 or xfs in a file, on a loop device. Needs root. A cut is
/// the file system's own, *_IOC_SHUTDOWN without a flush of the journal. Blocking.
class PowerDisk {
 public:
  /// Makes the file NAME.img, of so many bytes, and the folder NAME in `work`; not mounted yet.
  PowerDisk(const std::filesystem::path& work, const char* name, std::uintmax_t bytes,
            const std::string& file_system = "ext4");
  ~PowerDisk() { unmount(); }
  PowerDisk(const PowerDisk&) = delete;
  PowerDisk& operator=(const PowerDisk&) = delete;

  const std::filesystem::path& folder() const { return folder_; }

  /// Each is false if it failed.
  bool mount();
  /// From here on nothing is read or written, until it is mounted again.
  bool cut() const;
  bool unmount();

  /// To be called once, before the first: a copy of the mount in another mount namespace would keep
  /// a cut file system alive. What this process starts later sees each mount and unmount.
  static bool leave_other_mounts();

 private:
  const std::filesystem::path image_;
  const std::filesystem::path folder_;
  bool is_made_ = false;
  bool is_mounted_ = false;
};

}  // namespace orbbuf::bench

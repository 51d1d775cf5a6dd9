// SPDX-License-Identifier: Apache-2.0
#include "bench/power_disk.hpp"

#include <fcntl.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/mount.h>

#include <fstream>
#include <string>
#include <utility>

#include "common/unique_fd.hpp"
#include "testing/process.hpp"

namespace orbbuf::bench {

PowerDisk::PowerDisk(const std::filesystem::path& work, const char* name, std::uintmax_t bytes,
                     const std::string& file_system)
    : image_(work / (std::string(name) + ".img")), folder_(work / name) {
  std::filesystem::create_directories(folder_);
  std::ofstream(image_).close();
  std::filesystem::resize_file(image_, bytes);
  const char* const force = file_system == "ext4" ? "-F" : "-f";
  is_made_ = test::run({"mkfs." + file_system, "-q", force, image_.string()}).status == 0;
}

bool PowerDisk::mount() {
  is_mounted_ =
      is_made_ && test::run({"mount", "-o", "loop", image_.string(), folder_.string()}).status == 0;
  return is_mounted_;
}

bool PowerDisk::cut() const {
  constexpr unsigned long kShutdown = _IOR('X', 125, std::uint32_t);
  std::uint32_t no_flush = 2;  // *_GOING_FLAGS_NOLOGFLUSH
  const UniqueFd fd(::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  return fd && ::ioctl(fd.get(), kShutdown, &no_flush) == 0;
}

bool PowerDisk::unmount() {
  if (!std::exchange(is_mounted_, false)) return true;
  return test::run({"umount", folder_.string()}).status == 0;
}

bool PowerDisk::leave_other_mounts() {
  return ::unshare(CLONE_NEWNS) == 0 &&
         ::mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0 &&
         ::mount(nullptr, "/", nullptr, MS_REC | MS_SHARED, nullptr) == 0;
}

}  // namespace orbbuf::bench

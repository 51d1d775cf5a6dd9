// SPDX-License-Identifier: Apache-2.0
#include "server/session/durability.hpp"

#include <sys/vfs.h>

#include <algorithm>
#include <array>
#include <utility>

namespace orbbuf {

std::optional<std::string_view> weak_kind(std::uint32_t type) {
  // linux/magic.h
  static constexpr std::array<std::pair<std::uint32_t, std::string_view>, 9> kWeak{
      {{0x65735546, "FUSE"},
       {0x6969, "NFS"},
       {0xFE534D42, "SMB"},
       {0xFF534D42, "SMB"},
       {0x517B, "SMB"},
       {0x01021997, "9P"},
       {0x00C36400, "Ceph"},
       {0x5346414F, "AFS"},
       {0x73757245, "Coda"}}};
  const auto* const weak =
      std::ranges::find(kWeak, type, &std::pair<std::uint32_t, std::string_view>::first);
  return weak == kWeak.end() ? std::nullopt : std::optional(weak->second);
}

std::optional<std::string_view> weak_file_system(const std::filesystem::path& path) {
  struct statfs status {};
  if (::statfs(path.c_str(), &status) != 0) return std::nullopt;
  return weak_kind(static_cast<std::uint32_t>(status.f_type));
}

}  // namespace orbbuf

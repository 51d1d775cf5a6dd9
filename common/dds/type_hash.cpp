// SPDX-License-Identifier: Apache-2.0
#include "common/dds/type_hash.hpp"

#include <dds/dds.h>
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <string>

namespace orbbuf {
namespace {

struct TypeHash {
  std::string_view type;
  std::string_view hash;
};

/// SHA-256 of the types' descriptions, as REP 2016 lays down.
constexpr std::array<TypeHash, 5> kHashes = {
    {{"sensor_msgs::msg::dds_::CompressedImage_",
      "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"},
     {"sensor_msgs::msg::dds_::Image_",
      "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"},
     {"sensor_msgs::msg::dds_::CameraInfo_",
      "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275"},
     {"sensor_msgs::msg::dds_::Imu_",
      "7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"},
     {"rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_",
      "91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e"}}};

constexpr std::string_view kKey = "typehash=";

}  // namespace

void set_type_hash(dds_qos* qos, std::string_view type) {
  const auto* const found = std::ranges::find(kHashes, type, &TypeHash::type);
  if (found == kHashes.end()) return;
  const std::string data = fmt::format("{}RIHS01_{};", kKey, found->hash);
  dds_qset_userdata(qos, data.data(), data.size());
}

bool has_type_hash(const dds_qos* qos) {
  void* data = nullptr;
  std::size_t size = 0;
  if (!dds_qget_userdata(qos, &data, &size) || data == nullptr) return false;
  const bool has = std::string_view(static_cast<char*>(data), size).find(kKey) != std::string::npos;
  dds_free(data);
  return has;
}

}  // namespace orbbuf

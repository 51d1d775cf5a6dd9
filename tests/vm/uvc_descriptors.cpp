// SPDX-License-Identifier: Apache-2.0
#include "tests/vm/uvc_descriptors.hpp"

#include <algorithm>
#include <string_view>

namespace orbbuf::vm {
namespace {

using Bytes = std::vector<std::uint8_t>;

/// One descriptor, or several of them: little endian, each beginning with its length.
class Writer {
 public:
  Writer& u8(std::initializer_list<int> values) {
    for (const int value : values) bytes_.push_back(static_cast<std::uint8_t>(value));
    return *this;
  }
  Writer& u16(std::uint32_t value) { return little_endian(value, 2); }
  Writer& u32(std::uint32_t value) { return little_endian(value, 4); }
  Writer& append(const Bytes& bytes) {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
    return *this;
  }

  /// The bytes so far, with the length in front that they have with it.
  Bytes with_length() const {
    Bytes all(bytes_.size() + 1);
    all[0] = static_cast<std::uint8_t>(all.size());
    std::ranges::copy(bytes_, all.begin() + 1);
    return all;
  }
  const Bytes& bytes() const { return bytes_; }

 private:
  Writer& little_endian(std::uint32_t value, int count) {
    for (int i = 0; i < count; ++i) bytes_.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
    return *this;
  }
  Bytes bytes_;
};

// Kinds of descriptors: USB 2.0 table 9-5, UVC 1.0 tables.
constexpr int kDevice = 1, kConfiguration = 2, kString = 3, kInterface = 4, kEndpoint = 5;
constexpr int kAssociation = 11, kClassInterface = 0x24;
constexpr int kVcHeader = 1, kVcInput = 2, kVcOutput = 3;
constexpr int kVsHeader = 1, kVsUncompressed = 4, kVsUncompressedSize = 5, kVsMjpeg = 6,
              kVsMjpegSize = 7, kVsColor = 13;
constexpr int kVideo = 0x0E, kVideoControl = 1, kVideoStreaming = 2, kVideoCollection = 3;

Bytes size_descriptor(int kind, int index, const UvcSize& size) {
  const std::uint32_t bytes = 2U * size.width_px * size.height_px;
  return Writer()
      .u8({kClassInterface, kind, index, 0})
      .u16(size.width_px)
      .u16(size.height_px)
      .u32(bytes * 8 * kUvcRate)  // bits a second, least and most
      .u32(bytes * 8 * kUvcRate)
      .u32(bytes)
      .u32(kUvcInterval)
      .u8({1})  // of one interval
      .u32(kUvcInterval)
      .with_length();
}

void append_sizes(Writer& writer, int kind) {
  for (std::size_t i = 0; i < kUvcSizes.size(); ++i) {
    writer.append(size_descriptor(kind, static_cast<int>(i) + 1, kUvcSizes.at(i)));
  }
}

/// An input terminal (the sensor) that feeds an output terminal (the USB line), nothing between.
Bytes video_control() {
  const auto terminals =
      Writer()
          .append(Writer()
                      .u8({kClassInterface, kVcInput, 1, 1, 2, 0, 0})
                      .u16(0)
                      .u16(0)
                      .u16(0)
                      .u8({3, 0, 0, 0})
                      .with_length())
          .append(Writer().u8({kClassInterface, kVcOutput, 2, 1, 1, 0, 1, 0}).with_length())
          .bytes();
  const auto header_bytes = 13U;
  return Writer()
      .append(Writer()
                  .u8({kClassInterface, kVcHeader})
                  .u16(0x0100)
                  .u16(header_bytes + static_cast<std::uint32_t>(terminals.size()))
                  .u32(48'000'000)
                  .u8({1, 1})
                  .with_length())
      .append(terminals)
      .bytes();
}

Bytes video_streaming() {
  const int sizes = static_cast<int>(kUvcSizes.size());
  Writer formats;
  formats.append(Writer()
                     .u8({kClassInterface, kVsUncompressed, kUncompressed, sizes})
                     .u8({'Y', 'U', 'Y', '2', 0, 0, 0x10, 0, 0x80, 0, 0, 0xAA, 0, 0x38, 0x9B, 0x71})
                     .u8({16, 1, 0, 0, 0, 0})
                     .with_length());
  append_sizes(formats, kVsUncompressedSize);
  formats.append(
      Writer().u8({kClassInterface, kVsMjpeg, kMotionJpeg, sizes, 1, 1, 0, 0, 0, 0}).with_length());
  append_sizes(formats, kVsMjpegSize);
  formats.append(Writer().u8({kClassInterface, kVsColor, 1, 1, 4}).with_length());
  const auto header_bytes = 15U;
  return Writer()
      .append(Writer()
                  .u8({kClassInterface, kVsHeader, 2})
                  .u16(header_bytes + static_cast<std::uint32_t>(formats.bytes().size()))
                  .u8({0x81, 0, 2, 0, 0, 0, 1, 0, 0})
                  .with_length())
      .append(formats.bytes())
      .bytes();
}

}  // namespace

Bytes device_descriptor() {
  return Writer()
      .u8({kDevice})
      .u16(0x0200)
      .u8({0xEF, 2, 1, 64})
      .u16(0x1D6B)
      .u16(0x0102)
      .u16(0x0100)
      .u8({1, 2, 3, 1})
      .with_length();
}

Bytes configuration_descriptor() {
  const auto interface = [](int number, int endpoints, int subclass) {
    return Writer().u8({kInterface, number, 0, endpoints, kVideo, subclass, 0, 0}).with_length();
  };
  const auto inside =
      Writer()
          .append(Writer().u8({kAssociation, 0, 2, kVideo, kVideoCollection, 0, 2}).with_length())
          .append(interface(0, 0, kVideoControl))
          .append(video_control())
          .append(interface(1, 1, kVideoStreaming))
          .append(video_streaming())
          .append(Writer().u8({kEndpoint, 0x81, 2}).u16(512).u8({0}).with_length())
          .bytes();
  return Writer()
      .u8({9, kConfiguration})
      .u16(9 + static_cast<std::uint32_t>(inside.size()))
      .u8({2, 1, 0, 0x80, 50})
      .append(inside)
      .bytes();
}

Bytes string_descriptor(std::uint8_t index) {
  constexpr std::array<std::string_view, 4> kTexts = {"", "ORBBuf", "Simulated Camera", "1"};
  Writer writer;
  writer.u8({kString});
  if (index == 0) return writer.u16(0x0409).with_length();
  for (const char letter : kTexts.at(index % kTexts.size())) writer.u8({letter, 0});
  return writer.with_length();
}

}  // namespace orbbuf::vm

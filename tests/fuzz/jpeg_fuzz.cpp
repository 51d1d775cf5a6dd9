// SPDX-License-Identifier: Apache-2.0
// Any bytes as the images of one camera, through one encoder, one requantiser and one codec. A good
// image comes after each of them and must be unharmed. An image: two bytes of length, then its
// bytes.
#include <algorithm>
#include <cstdlib>
#include <span>

#include "common/jpeg.hpp"
#include "daemon/image/jpeg_encoder.hpp"
#include "daemon/image/requantiser.hpp"

namespace orbbuf {
namespace {

using Bytes = std::vector<std::uint8_t>;

void require(bool holds) {
  if (!holds) std::abort();
}

/// The robot's encoder and the server's codec, for the life of one input.
class Path {
 public:
  /// The pixels that the server makes of `jpeg`; nothing if it is not a good image.
  Bytes through(std::span<const std::uint8_t> jpeg) {
    RawFrame raw;
    raw.format = PixelFormat::kJpeg;
    raw.data = jpeg;
    const auto frame = encoder_.encode(raw, 0);
    if (!frame) return {};
    require(codec_.inspect(frame.value().jpeg).has_value());
    if (frame.value().width_px * frame.value().height_px > kMaxPixels) return {};
    static_cast<void>(codec_.halve(frame.value().jpeg));
    auto image = codec_.decode_gray(frame.value().jpeg, 1);
    const auto reduced = requantiser_.reduce(frame.value(), 30);
    require(!image || !reduced || codec_.decode_gray(reduced.value().jpeg, 1).has_value());
    return image ? std::move(image.value().pixels) : Bytes();
  }

 private:
  static constexpr int kMaxPixels = 1 << 20;  // larger ones only cost time

  JpegEncoder encoder_{{}};
  Requantiser requantiser_;
  JpegCodec codec_;
};

Bytes good_jpeg() {
  constexpr int kSide = 32;
  Bytes pixels(std::size_t{kSide} * kSide);
  for (std::size_t i = 0; i < pixels.size(); ++i) pixels[i] = static_cast<std::uint8_t>(i * 37);
  return JpegCodec().encode({pixels.data(), kSide, kSide, kSide, 1}, 80, false).value();
}

void run(std::span<const std::uint8_t> input) {
  static const Bytes good = good_jpeg();
  static const Bytes pixels = Path().through(good);
  require(!pixels.empty());
  Path path;
  while (input.size() >= 2) {
    const std::size_t stated = std::size_t{input[0]} * 256 + input[1];
    const auto image = input.subspan(2, std::min(stated, input.size() - 2));
    static_cast<void>(path.through(image));
    require(path.through(good) == pixels);
    input = input.subspan(2 + image.size());
  }
}

}  // namespace
}  // namespace orbbuf

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  orbbuf::run({data, size});
  return 0;
}

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/error.hpp"

namespace orbbuf {

struct Libjpeg;

/// A view of 8-bit pixels, rows top to bottom. Does not own them.
struct ImageView {
  const std::uint8_t* data = nullptr;
  int width_px = 0;
  int height_px = 0;
  std::size_t stride_bytes = 0;
  int channels = 1;  ///< 1: gray; 3: blue, green, red
};

/// The sizes of an image's 4:2:0 planes: luma, then blue and red chroma, one behind the other, rows
/// without padding. Luma of an odd width or height has a column or row more, which is not seen.
struct Yuv420Layout {
  constexpr Yuv420Layout(int width_px, int height_px)
      : columns(static_cast<std::size_t>(width_px + 1) / 2),
        rows(static_cast<std::size_t>(height_px + 1) / 2) {}

  std::size_t columns;  ///< of each chroma plane; luma has twice as many
  std::size_t rows;

  constexpr std::size_t chroma_bytes() const { return columns * rows; }
  constexpr std::size_t luma_bytes() const { return 4 * chroma_bytes(); }
  constexpr std::size_t bytes() const { return 6 * chroma_bytes(); }
};

/// Gray pixels, row by row without padding.
struct GrayImage {
  int width_px = 0;
  int height_px = 0;
  std::vector<std::uint8_t> pixels;
};

/// Larger images are refused before anything is allocated for them: a JPEG of a few bytes can claim
/// 4 gigapixels.
inline constexpr std::int64_t kMaxJpegPixels = 64LL * 1024 * 1024;

/// The two JPEGs that one was split into.
struct JpegHalves {
  std::vector<std::uint8_t> left;
  std::vector<std::uint8_t> right;
};

struct JpegInfo {
  int width_px = 0;
  int height_px = 0;
  bool is_gray = false;
  std::size_t bytes = 0;  ///< up to its end marker, and with it; what is behind is not the image's
  bool has_end = false;   ///< false: all bytes are the image's, and its end marker is missing
};

/// libjpeg, its objects reused from call to call. Which JPEGs it reads, and which it repairs, is
/// said in libjpeg.hpp. An image with an error does not affect the next one. Thread-bound: one
/// object per thread.
class JpegCodec {
 public:
  /// Logs repairs as those of `owner`, if it is not empty.
  explicit JpegCodec(std::string owner = "");
  ~JpegCodec();
  JpegCodec(const JpegCodec&) = delete;
  JpegCodec& operator=(const JpegCodec&) = delete;

  /// quality: 1..100, others are clamped. Grayscale if `image` is gray or `color` is false, else
  /// 4:2:0 colour. About 1 ms for 1226x370 gray at quality 80.
  Result<std::vector<std::uint8_t>> encode(const ImageView& image, int quality, bool color);

  /// The same in 4:2:0 colour, from `planes` of a Yuv420Layout, which are at least its bytes()
  /// long.
  Result<std::vector<std::uint8_t>> encode_yuv420(std::span<const std::uint8_t> planes,
                                                  int width_px, int height_px, int quality);

  /// The luma of `jpeg`, 1/`scale` of its size each way (scale 1, 2, 4 or 8; rounded up), scaled
  /// within the DCT. A JPEG with missing or corrupt data is an error.
  Result<GrayImage> decode_gray(std::span<const std::uint8_t> jpeg, int scale);

  /// Reads the header and looks for the end marker, which is missing in a truncated file or camera
  /// buffer. Cheap; but an image without it is decoded, and an error if pixels are missing, too.
  Result<JpegInfo> inspect(std::span<const std::uint8_t> jpeg);

  /// `jpeg` cut in the middle, without loss: its blocks are taken over, its pixels not decoded. An
  /// error if each half is not whole blocks wide (multiples of 8 pixels; with colour as cameras and
  /// this program encode it, of 16), or if data are missing or corrupt. 1 to 2 ms for 640x480,
  /// about what decoding and encoding again would cost.
  Result<JpegHalves> halve(std::span<const std::uint8_t> jpeg);

  /// How many JPEGs were repaired.
  std::uint64_t repaired() const;

 private:
  const std::unique_ptr<Libjpeg> jpeg_;
};

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#include "testing/restart_jpeg.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>

#include "common/libjpeg.hpp"

namespace orbbuf::test {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes encode(int width_px, int height_px, bool is_color) {
  Libjpeg libjpeg("");
  Bytes row(static_cast<std::size_t>(3 * width_px));
  std::uint32_t random = 1;
  const bool is_done = libjpeg.run([&] {
    jpeg_compress_struct& out = libjpeg.out;
    out.image_width = static_cast<JDIMENSION>(width_px);
    out.image_height = static_cast<JDIMENSION>(height_px);
    out.input_components = is_color ? 3 : 1;
    out.in_color_space = is_color ? JCS_RGB : JCS_GRAYSCALE;
    jpeg_set_defaults(&out);
    if (is_color) out.comp_info[0].v_samp_factor = 1;
    out.restart_in_rows = 1;
    jpeg_start_compress(&out, TRUE);
    while (out.next_scanline < out.image_height) {
      for (auto& value : row) {
        random = random * 1664525 + 1013904223;
        value = static_cast<std::uint8_t>(random >> 24U);
      }
      JSAMPROW pixels = row.data();
      jpeg_write_scanlines(&out, &pixels, 1);
    }
    jpeg_finish_compress(&out);
  });
  if (!is_done) throw std::runtime_error(libjpeg.why.data());
  return {libjpeg.written().begin(), libjpeg.written().end()};
}

}  // namespace

Bytes restart_jpeg(int width_px, int height_px, bool is_color, std::size_t spare) {
  const Bytes jpeg = encode(width_px, height_px, is_color);
  constexpr std::array<std::uint8_t, 2> kScan = {0xFF, 0xDA};
  const auto scan = std::search(jpeg.begin(), jpeg.end(), kScan.begin(), kScan.end());
  Bytes with(jpeg.begin(), scan);
  for (auto at = scan; at != jpeg.end(); ++at) {
    if (*at == 0xFF && at + 1 != jpeg.end() && at[1] >= 0xD0 && at[1] <= 0xD7) {
      with.insert(with.end(), spare, 0x55);
    }
    with.push_back(*at);
  }
  return with;
}

Bytes with_zeros_in_head(Bytes jpeg, std::size_t count) {
  const auto length = jpeg[4] * 256 + jpeg[5];
  jpeg.insert(jpeg.begin() + 4 + length, count, 0);
  return jpeg;
}

}  // namespace orbbuf::test

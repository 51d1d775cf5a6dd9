// SPDX-License-Identifier: Apache-2.0
#include "common/jpeg.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstring>
#include <utility>

#include "common/libjpeg.hpp"

namespace orbbuf {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t kBlockPx = DCTSIZE;
constexpr std::size_t kStripRows = 2 * kBlockPx;  // of 4:2:0 colour

Error error_of(std::string_view attempt, const Libjpeg& jpeg) {
  return Error{fmt::format("{}: {}", attempt, jpeg.why.data())};
}

/// What an image of this size begins with, but for what the caller changes.
void set_up(jpeg_compress_struct& out, int width_px, int height_px, J_COLOR_SPACE pixels,
            bool is_gray, int quality) {
  out.image_width = static_cast<JDIMENSION>(width_px);
  out.image_height = static_cast<JDIMENSION>(height_px);
  out.in_color_space = pixels;
  out.input_components = pixels == JCS_GRAYSCALE ? 1 : 3;
  jpeg_set_defaults(&out);  // 4:2:0
  if (is_gray) jpeg_set_colorspace(&out, JCS_GRAYSCALE);
  jpeg_set_quality(&out, quality, TRUE);
  constexpr int kExact = 96;  // from here on the fast DCT costs more than it saves
  out.dct_method = quality < kExact ? JDCT_IFAST : JDCT_ISLOW;
}

Result<Bytes> encoded(const Libjpeg& jpeg, bool is_done) {
  if (!is_done) {
    return error_of(fmt::format("cannot encode an image of {}x{} pixels", jpeg.out.image_width,
                                jpeg.out.image_height),
                    jpeg);
  }
  return Bytes(jpeg.written().begin(), jpeg.written().end());
}

/// The planes of a Yuv420Layout in strips, as libjpeg takes them: each 16 rows of luma, 8 of each
/// chroma, all of whole blocks. What is missing repeats the last column and row.
class Strips {
 public:
  Strips(std::span<const std::uint8_t> planes, int width_px, int height_px) {
    const Yuv420Layout layout(width_px, height_px);
    assert(planes.size() >= layout.bytes());
    const std::uint8_t* data = planes.data();
    for (std::size_t i = 0; i < planes_.size(); ++i) {
      const std::size_t times = i == 0 ? 2 : 1;
      planes_[i] = {data, times * layout.columns, times * layout.rows, times * kBlockPx};
      data += planes_[i].columns * planes_[i].rows;
    }
    padded_.resize(2 * (layout.columns + kBlockPx) * (kStripRows + kBlockPx));
  }

  /// From row `first` of luma on.
  JSAMPIMAGE at(std::size_t first) {
    std::uint8_t* padded = padded_.data();
    for (std::size_t i = 0; i < planes_.size(); ++i) {
      const auto [data, columns, rows, height] = planes_[i];
      const std::size_t blocks_end = (columns + height - 1) / height * height;
      for (std::size_t y = 0; y < height; ++y) {
        const std::size_t row = std::min(first * height / kStripRows + y, rows - 1);
        std::memcpy(padded, data + row * columns, columns);
        std::memset(padded + columns, padded[columns - 1], blocks_end - columns);
        rows_[i][y] = padded;
        padded += blocks_end;
      }
      strips_[i] = rows_[i].data();
    }
    return strips_.data();
  }

 private:
  struct Plane {
    const std::uint8_t* data;
    std::size_t columns;
    std::size_t rows;
    std::size_t strip_rows;
  };
  std::array<Plane, 3> planes_{};
  Bytes padded_;
  std::array<std::array<JSAMPROW, kStripRows>, 3> rows_{};
  std::array<JSAMPARRAY, 3> strips_{};
};

/// After read_header().
void decode(Libjpeg& jpeg, int scale, GrayImage& image) {
  jpeg_decompress_struct& in = jpeg.in;
  in.out_color_space = JCS_GRAYSCALE;
  in.scale_num = 1;
  in.scale_denom = static_cast<unsigned>(scale);
  jpeg_start_decompress(&in);
  image.width_px = static_cast<int>(in.output_width);
  image.height_px = static_cast<int>(in.output_height);
  image.pixels.resize(std::size_t{in.output_width} * in.output_height);
  while (in.output_scanline < in.output_height) {
    JSAMPROW row = image.pixels.data() + std::size_t{in.output_width} * in.output_scanline;
    jpeg_read_scanlines(&in, &row, 1);
  }
  jpeg.finish_reading();
}

/// Behind the end marker; 0: there is none. `at`: where the first scan begins. In it 00, 01 and the
/// restart markers, D0 to D7, may come behind FF; all others but the end have a length.
std::size_t end_of_image(std::span<const std::uint8_t> jpeg, std::size_t at) {
  while (at < jpeg.size()) {
    const void* const found = std::memchr(&jpeg[at], 0xFF, jpeg.size() - at);
    if (found == nullptr) return 0;
    at = static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - jpeg.data());
    while (at < jpeg.size() && jpeg[at] == 0xFF) ++at;
    if (at == jpeg.size() || jpeg[at] == 0xD8) return 0;
    const std::uint8_t code = jpeg[at++];
    if (code == 0xD9) return at;
    if (code <= 1 || (code >= 0xD0 && code <= 0xD7)) continue;
    if (at + 2 > jpeg.size()) return 0;
    at += std::size_t{jpeg[at]} * 256 + jpeg[at + 1];
  }
  return 0;
}

/// Moves the right half of each row of blocks to the left.
void move_right_half(jpeg_decompress_struct& in, jvirt_barray_ptr* coefficients) {
  for (int i = 0; i < in.num_components; ++i) {
    const std::size_t half = in.comp_info[i].width_in_blocks / 2;
    for (JDIMENSION y = 0; y < in.comp_info[i].height_in_blocks; ++y) {
      JBLOCK* const row = *in.mem->access_virt_barray(reinterpret_cast<j_common_ptr>(&in),
                                                      coefficients[i], y, 1, TRUE);
      std::memmove(row, row + half, half * sizeof(JBLOCK));
    }
  }
}

}  // namespace

JpegCodec::JpegCodec(std::string owner) : jpeg_(std::make_unique<Libjpeg>(std::move(owner))) {}

JpegCodec::~JpegCodec() = default;

std::uint64_t JpegCodec::repaired() const { return jpeg_->repaired; }

Result<Bytes> JpegCodec::encode(const ImageView& image, int quality, bool color) {
  assert(image.channels == 1 || image.channels == 3);
  const bool is_done = jpeg_->run([&] {
    jpeg_compress_struct& out = jpeg_->out;
    set_up(out, image.width_px, image.height_px, image.channels == 1 ? JCS_GRAYSCALE : JCS_EXT_BGR,
           image.channels == 1 || !color, quality);
    jpeg_start_compress(&out, TRUE);
    while (out.next_scanline < out.image_height) {
      auto* row = const_cast<JSAMPROW>(image.data + image.stride_bytes * out.next_scanline);
      jpeg_write_scanlines(&out, &row, 1);
    }
    jpeg_finish_compress(&out);
  });
  return encoded(*jpeg_, is_done);
}

Result<Bytes> JpegCodec::encode_yuv420(std::span<const std::uint8_t> planes, int width_px,
                                       int height_px, int quality) {
  Strips strips(planes, width_px, height_px);
  const bool is_done = jpeg_->run([&] {
    jpeg_compress_struct& out = jpeg_->out;
    set_up(out, width_px, height_px, JCS_YCbCr, false, quality);
    out.raw_data_in = TRUE;
    jpeg_start_compress(&out, TRUE);
    while (out.next_scanline < out.image_height) {
      jpeg_write_raw_data(&out, strips.at(out.next_scanline), kStripRows);
    }
    jpeg_finish_compress(&out);
  });
  return encoded(*jpeg_, is_done);
}

Result<GrayImage> JpegCodec::decode_gray(std::span<const std::uint8_t> jpeg, int scale) {
  assert(scale == 1 || scale == 2 || scale == 4 || scale == 8);
  GrayImage image;
  const bool is_done = jpeg_->run([&] {
    jpeg_->read_header(jpeg);
    decode(*jpeg_, scale, image);
  });
  if (!is_done) return error_of("cannot decode a JPEG", *jpeg_);
  return image;
}

Result<JpegInfo> JpegCodec::inspect(std::span<const std::uint8_t> jpeg) {
  JpegInfo info;
  GrayImage image;
  const bool is_done = jpeg_->run([&] {
    jpeg_->read_header(jpeg);
    const jpeg_decompress_struct& in = jpeg_->in;
    const std::size_t end = end_of_image(jpeg, jpeg.size() - in.src->bytes_in_buffer);
    info = {static_cast<int>(in.image_width), static_cast<int>(in.image_height),
            in.num_components == 1, end == 0 ? jpeg.size() : end, end != 0};
    if (end == 0) return decode(*jpeg_, DCTSIZE, image);
    if (end == jpeg.size() || jpeg_->repair[0] != '\0') return;
    *fmt::format_to(jpeg_->repair.data(), "it has bytes behind its end marker") = '\0';
  });
  if (!is_done) return error_of("cannot read a JPEG", *jpeg_);
  return info;
}

Result<JpegHalves> JpegCodec::halve(std::span<const std::uint8_t> jpeg) {
  std::array<Bytes, 2> halves;
  const bool is_done = jpeg_->run([&] {
    jpeg_->read_header(jpeg);
    jpeg_decompress_struct& in = jpeg_->in;
    const unsigned block_px =
        DCTSIZE * static_cast<unsigned>(in.num_components == 1 ? 1 : in.max_h_samp_factor);
    if (in.image_width % (2 * block_px) != 0) {
      jpeg_->fail("it has {}x{} px, and each half must be a multiple of {} px wide", in.image_width,
                  in.image_height, block_px);
    }
    jvirt_barray_ptr* const coefficients = jpeg_read_coefficients(&in);
    for (std::size_t i = 0; i < halves.size(); ++i) {
      if (i == 1) move_right_half(in, coefficients);
      jpeg_copy_critical_parameters(&in, &jpeg_->out);
      jpeg_->out.image_width = in.image_width / 2;
      jpeg_->write(coefficients);
      halves[i].assign(jpeg_->written().begin(), jpeg_->written().end());
    }
    jpeg_->finish_reading();
  });
  if (!is_done) return error_of("cannot split a JPEG", *jpeg_);
  return JpegHalves{std::move(halves[0]), std::move(halves[1])};
}

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#include "common/jpeg.hpp"

#include <fmt/core.h>
#include <turbojpeg.h>

#include <array>
#include <cassert>
#include <memory>
#include <stdexcept>

namespace orbbuf {
namespace {

struct Header {
  int width_px = 0;
  int height_px = 0;
  int subsampling = -1;
  int color_space = -1;
};

/// After an error TurboJPEG 2.1 may stand within the broken header and read the next image from
/// there, as 0x0 pixels, so `handle` is replaced: a transformer, which compresses and decompresses
/// as well. Null if there is no memory; calls then fail until there is.
Error turbo_error(std::string_view attempt, tjhandle& handle) {
  Error error{fmt::format("{}: {}", attempt, tjGetErrorStr2(handle))};
  if (handle != nullptr) tjDestroy(handle);
  handle = tjInitTransform();
  return error;
}

Result<Header> read_header(tjhandle& handle, std::span<const std::uint8_t> jpeg) {
  Header header;
  if (tjDecompressHeader3(handle, jpeg.data(), jpeg.size(), &header.width_px, &header.height_px,
                          &header.subsampling, &header.color_space) != 0) {
    return turbo_error("cannot read the header of a JPEG", handle);
  }
  if (std::int64_t{header.width_px} * header.height_px > kMaxJpegPixels) {
    return Error{fmt::format("JPEG of {}x{} pixels is over the limit of {} pixels", header.width_px,
                             header.height_px, kMaxJpegPixels)};
  }
  return header;
}

}  // namespace

JpegCodec::JpegCodec() : turbo_(tjInitTransform()) {
  if (turbo_ == nullptr) throw std::runtime_error("cannot set up TurboJPEG: out of memory");
}

JpegCodec::~JpegCodec() {
  if (turbo_ != nullptr) tjDestroy(turbo_);
}

template <class Compress>
Result<std::vector<std::uint8_t>> JpegCodec::compress(int width_px, int height_px, int quality,
                                                      const Compress& compress) {
  unsigned char* data = nullptr;  // TurboJPEG's, grown as needed
  unsigned long size = 0;
  const int status = compress(&data, &size);
  const std::unique_ptr<unsigned char, decltype(&tjFree)> owner(data, &tjFree);
  if (status != 0) {
    return turbo_error(fmt::format("cannot encode an image of {}x{} pixels at quality {}", width_px,
                                   height_px, quality),
                       turbo_);
  }
  return std::vector<std::uint8_t>(data, data + size);
}

Result<std::vector<std::uint8_t>> JpegCodec::encode(const ImageView& image, int quality,
                                                    bool color) {
  assert(image.channels == 1 || image.channels == 3);
  const bool is_gray = image.channels == 1 || !color;
  const auto compress_pixels = [&](unsigned char** data, unsigned long* size) {
    return tjCompress2(turbo_, image.data, image.width_px, static_cast<int>(image.stride_bytes),
                       image.height_px, image.channels == 1 ? TJPF_GRAY : TJPF_BGR, data, size,
                       is_gray ? TJSAMP_GRAY : TJSAMP_420, quality, 0);
  };
  return compress(image.width_px, image.height_px, quality, compress_pixels);
}

Result<std::vector<std::uint8_t>> JpegCodec::encode_yuv420(std::span<const std::uint8_t> planes,
                                                           int width_px, int height_px,
                                                           int quality) {
  const Yuv420Layout layout(width_px, height_px);
  assert(planes.size() >= layout.bytes());
  const std::uint8_t* const luma = planes.data();
  const std::uint8_t* const blue = luma + layout.luma_bytes();
  std::array<const unsigned char*, 3> begins = {luma, blue, blue + layout.chroma_bytes()};
  const auto compress_planes = [&](unsigned char** data, unsigned long* size) {
    return tjCompressFromYUVPlanes(turbo_, begins.data(), width_px, nullptr, height_px, TJSAMP_420,
                                   data, size, quality, 0);
  };
  return compress(width_px, height_px, quality, compress_planes);
}

Result<GrayImage> JpegCodec::decode_gray(std::span<const std::uint8_t> jpeg, int scale) {
  assert(scale == 1 || scale == 2 || scale == 4 || scale == 8);
  const Result<Header> header = read_header(turbo_, jpeg);
  if (!header) return header.error();
  const tjscalingfactor factor = {1, scale};
  GrayImage image;
  image.width_px = TJSCALED(header.value().width_px, factor);
  image.height_px = TJSCALED(header.value().height_px, factor);
  image.pixels.resize(static_cast<std::size_t>(image.width_px) *
                      static_cast<std::size_t>(image.height_px));
  // libjpeg fills what is missing with gray and only warns; LIMITSCANS stops progressive bombs.
  if (tjDecompress2(turbo_, jpeg.data(), jpeg.size(), image.pixels.data(), image.width_px, 0,
                    image.height_px, TJPF_GRAY, TJFLAG_STOPONWARNING | TJFLAG_LIMITSCANS) != 0) {
    return turbo_error("cannot decode a JPEG", turbo_);
  }
  return image;
}

Result<JpegInfo> JpegCodec::inspect(std::span<const std::uint8_t> jpeg) {
  const Result<Header> header = read_header(turbo_, jpeg);  // insists on SOI at the start
  if (!header) return header.error();
  std::size_t end = jpeg.size();
  while (end > 0 && jpeg[end - 1] == 0) --end;
  if (end < 2 || jpeg[end - 2] != 0xFF || jpeg[end - 1] != 0xD9) {
    return Error{"JPEG is truncated: no end marker"};
  }
  return JpegInfo{header.value().width_px, header.value().height_px,
                  header.value().color_space == TJCS_GRAY};
}

Result<JpegHalves> JpegCodec::halve(std::span<const std::uint8_t> jpeg) {
  const Result<Header> header = read_header(turbo_, jpeg);
  if (!header) return header.error();
  const auto [width_px, height_px, subsampling, color_space] = header.value();
  const int block_px = subsampling < 0 ? 0 : tjMCUWidth[subsampling];
  if (block_px == 0 || width_px % (2 * block_px) != 0) {
    return Error{
        fmt::format("cannot split a JPEG of {}x{} px: each half must be a multiple of {} px wide",
                    width_px, height_px, block_px)};
  }
  std::array<tjtransform, 2> cuts{};
  for (tjtransform& cut : cuts) {
    cut.r = {0, 0, width_px / 2, height_px};
    cut.options = TJXOPT_CROP;
  }
  cuts[1].r.x = width_px / 2;
  std::array<unsigned char*, 2> data{};  // TurboJPEG's, grown as needed
  std::array<unsigned long, 2> sizes{};
  const int status = tjTransform(turbo_, jpeg.data(), jpeg.size(), 2, data.data(), sizes.data(),
                                 cuts.data(), TJFLAG_STOPONWARNING | TJFLAG_LIMITSCANS);
  const std::unique_ptr<unsigned char, decltype(&tjFree)> left(data[0], &tjFree);
  const std::unique_ptr<unsigned char, decltype(&tjFree)> right(data[1], &tjFree);
  if (status != 0) return turbo_error("cannot split a JPEG", turbo_);
  return JpegHalves{{left.get(), left.get() + sizes[0]}, {right.get(), right.get() + sizes[1]}};
}

}  // namespace orbbuf

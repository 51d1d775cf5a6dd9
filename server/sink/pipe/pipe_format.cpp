// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe/pipe_format.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <iterator>
#include <span>
#include <string_view>

#include "common/decimal.hpp"
#include "common/seconds.hpp"

namespace orbbuf {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Image = std::span<const std::uint8_t>;

enum class Camera : std::uint8_t { kOnly, kLeft, kRight };

constexpr std::uint8_t kMarker = 0xFF;
constexpr std::uint8_t kStart = 0xD8;
constexpr std::uint8_t kEnd = 0xD9;
constexpr std::uint8_t kComment = 0xFE;

/// Each line after `prefix`.
std::string head_lines(const EncodedFrame& frame, Camera camera, const PipeNote& note,
                       std::string_view prefix) {
  std::string lines = fmt::format("{0}seq={1}\n{0}t={2}\n", prefix, frame.sequence,
                                  format_seconds(frame.capture_time_ns));
  if (camera != Camera::kOnly) {
    lines += fmt::format("{}camera={}\n", prefix, camera == Camera::kLeft ? "left" : "right");
  }
  if (frame.quality > 0) lines += fmt::format("{}quality={}\n", prefix, frame.quality);
  if (frame.is_reduced()) lines += fmt::format("{}whole={}\n", prefix, frame.whole_bytes);
  if (note.missed > 0) lines += fmt::format("{}missed={}\n", prefix, note.missed);
  if (note.age) lines += fmt::format("{}age={:.3f}\n", prefix, to_seconds(*note.age));
  lines += fmt::format("{}session={}\n", prefix, note.session);
  if (camera == Camera::kRight) return lines;
  for (const std::string& sample : note.samples) lines.append(prefix).append(sample);
  return lines;
}

/// Whole lines in each.
void append_comments(Bytes& out, std::string_view lines) {
  constexpr std::size_t kMostBytes = 65'000;
  while (!lines.empty()) {
    const auto end = lines.size() <= kMostBytes ? lines.size() : lines.rfind('\n', kMostBytes) + 1;
    const std::size_t length = end + 2;  // of the segment, which includes these two bytes
    out.insert(out.end(), {kMarker, kComment, static_cast<std::uint8_t>(length >> 8U),
                           static_cast<std::uint8_t>(length)});
    out.insert(out.end(), lines.begin(), lines.begin() + static_cast<std::ptrdiff_t>(end));
    lines.remove_prefix(end);
  }
}

/// All images of `frame`, each by `add(out, image, camera)`, which returns why it cannot.
template <class Add>
Result<Bytes> each_image(const EncodedFrame& frame, Add add) {
  Bytes out;
  auto error = add(out, frame.left(), frame.is_stereo() ? Camera::kLeft : Camera::kOnly);
  if (!error && frame.is_stereo()) error = add(out, frame.right(), Camera::kRight);
  if (error) return *std::move(error);
  return out;
}

}  // namespace

Result<Bytes> to_pgm(const EncodedFrame& frame, const PipeNote& note, JpegCodec& codec) {
  return each_image(frame, [&](Bytes& out, Image jpeg, Camera camera) -> std::optional<Error> {
    auto image = codec.decode_gray(jpeg, 1);
    if (!image) return std::move(image).error();
    const auto& [width_px, height_px, pixels] = image.value();
    const std::string head = fmt::format(
        "P5\n{}{} {}\n255\n", head_lines(frame, camera, note, "# "), width_px, height_px);
    out.reserve(out.size() + head.size() + pixels.size());
    out.insert(out.end(), head.begin(), head.end());
    out.insert(out.end(), pixels.begin(), pixels.end());
    return std::nullopt;
  });
}

Result<Bytes> to_mjpeg(const EncodedFrame& frame, const PipeNote& note) {
  return each_image(frame, [&](Bytes& out, Image jpeg, Camera camera) -> std::optional<Error> {
    while (!jpeg.empty() && jpeg.back() == 0) jpeg = jpeg.first(jpeg.size() - 1);
    constexpr std::size_t kLeast = 4;
    if (jpeg.size() < kLeast || jpeg[0] != kMarker || jpeg[1] != kStart ||
        jpeg[jpeg.size() - 2] != kMarker || jpeg.back() != kEnd) {
      return Error{"it does not begin and end as a JPEG does"};
    }
    const std::string lines = head_lines(frame, camera, note, "");
    std::copy_n(jpeg.begin(), 2, std::back_inserter(out));
    append_comments(out, lines);
    out.insert(out.end(), jpeg.begin() + 2, jpeg.end());
    return std::nullopt;
  });
}

}  // namespace orbbuf

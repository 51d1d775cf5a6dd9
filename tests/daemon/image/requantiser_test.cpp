// SPDX-License-Identifier: Apache-2.0
#include "daemon/image/requantiser.hpp"

#include <gmock/gmock.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "common/jpeg.hpp"
#include "common/wire.hpp"
#include "daemon/capture/make_source.hpp"
#include "daemon/image/jpeg_encoder.hpp"
#include "daemon/image/standard_head.hpp"
#include "testing/restart_jpeg.hpp"

extern "C" {
#include <jpeglib.h>  // after <cstdio>, which it needs and does not include
}

namespace orbbuf {
namespace {

using testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;

constexpr int kWidth = 150, kHeight = 110;  // no multiples of 8

RawFrame scene(bool color) {
  SourceSettings settings;
  settings.width_px = kWidth;
  settings.height_px = kHeight;
  settings.color = color;
  settings.realtime = false;
  return *make_source(settings)->next({});
}

/// What an image is encoded with; JpegCodec offers too little.
struct Encoding {
  int quality = 80;
  bool is_color = true;
  int columns = 2, rows = 2;  // luma samples for one of chroma
  unsigned restart_interval = 0;
  bool is_progressive = false;
  bool has_one_table = false;      // for luma and chroma
  bool has_one_scan_each = false;  // for each component
  bool has_best_code = false;      // Huffman's, for this image
  std::string comment = {}, app = {};
};

Bytes encoded(const Encoding& encoding) {
  const RawFrame raw = scene(encoding.is_color);
  jpeg_error_mgr errors;
  jpeg_compress_struct out;
  out.err = jpeg_std_error(&errors);  // ends the program
  jpeg_create_compress(&out);
  unsigned char* data = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&out, &data, &size);
  out.image_width = kWidth;
  out.image_height = kHeight;
  out.input_components = encoding.is_color ? 3 : 1;
  out.in_color_space = encoding.is_color ? JCS_EXT_BGR : JCS_GRAYSCALE;
  jpeg_set_defaults(&out);
  jpeg_set_quality(&out, encoding.quality, TRUE);
  out.comp_info[0].h_samp_factor = encoding.is_color ? encoding.columns : 1;
  out.comp_info[0].v_samp_factor = encoding.is_color ? encoding.rows : 1;
  if (encoding.has_one_table) {
    for (int i = 0; i < 3; ++i) out.comp_info[i].quant_tbl_no = 0;
  }
  out.restart_interval = encoding.restart_interval;
  out.optimize_coding = encoding.has_best_code ? TRUE : FALSE;
  std::array<jpeg_scan_info, 3> scans{};
  for (int i = 0; i < 3; ++i) scans[static_cast<std::size_t>(i)] = {1, {i}, 0, 63, 0, 0};
  if (encoding.has_one_scan_each) {
    out.scan_info = scans.data();
    out.num_scans = 3;
  }
  if (encoding.is_progressive) jpeg_simple_progression(&out);
  jpeg_start_compress(&out, TRUE);
  const auto add = [&](int marker, const std::string& text) {
    if (text.empty()) return;
    jpeg_write_marker(&out, marker, reinterpret_cast<const JOCTET*>(text.data()),
                      static_cast<unsigned>(text.size()));
  };
  add(JPEG_APP0 + 1, encoding.app);
  add(JPEG_COM, encoding.comment);
  while (out.next_scanline < out.image_height) {
    auto* row = const_cast<JSAMPROW>(raw.data.data() + out.next_scanline * raw.stride_bytes);
    jpeg_write_scanlines(&out, &row, 1);
  }
  jpeg_finish_compress(&out);
  jpeg_destroy_compress(&out);
  const std::unique_ptr<unsigned char, decltype(&std::free)> owner(data, &std::free);
  return {data, data + size};
}

EncodedFrame frame_of(Bytes jpeg) {
  EncodedFrame frame;
  frame.sequence = 7;
  frame.capture_time_ns = 1'305'031'102'175'304'000;
  frame.exposure_ns = 10'000'000;
  frame.width_px = kWidth;
  frame.height_px = kHeight;
  frame.jpeg_crc = wire::crc32(jpeg);
  frame.left_bytes = static_cast<std::uint32_t>(jpeg.size());
  frame.jpeg = std::move(jpeg);
  return frame;
}

struct Head {
  J_COLOR_SPACE color_space = JCS_UNKNOWN;
  bool is_progressive = false;
  unsigned restart_interval = 0;
  std::vector<std::array<int, 2>> sampling;         // of each component
  std::vector<std::array<UINT16, DCTSIZE2>> steps;  // likewise
  std::vector<std::string> markers;
};

Head head_of(std::span<const std::uint8_t> jpeg) {
  jpeg_error_mgr errors;
  jpeg_decompress_struct in;
  in.err = jpeg_std_error(&errors);
  jpeg_create_decompress(&in);
  jpeg_mem_src(&in, jpeg.data(), static_cast<unsigned long>(jpeg.size()));
  jpeg_save_markers(&in, JPEG_COM, 0xFFFF);
  for (int i = 0; i < 16; ++i) jpeg_save_markers(&in, JPEG_APP0 + i, 0xFFFF);
  jpeg_read_header(&in, TRUE);
  Head head{in.jpeg_color_space, in.progressive_mode != 0, in.restart_interval, {}, {}, {}};
  for (int i = 0; i < in.num_components; ++i) {
    const auto& component = in.comp_info[i];
    head.sampling.push_back({component.h_samp_factor, component.v_samp_factor});
    head.steps.emplace_back();
    std::copy_n(in.quant_tbl_ptrs[component.quant_tbl_no]->quantval, DCTSIZE2,
                head.steps.back().begin());
  }
  for (auto* marker = in.marker_list; marker != nullptr; marker = marker->next) {
    head.markers.emplace_back(1, static_cast<char>(marker->marker));
    head.markers.back().append(reinterpret_cast<const char*>(marker->data), marker->data_length);
  }
  jpeg_destroy_decompress(&in);
  return head;
}

/// Of luma, in dB.
double likeness(std::span<const std::uint8_t> a, std::span<const std::uint8_t> b) {
  JpegCodec codec;
  const auto image_a = codec.decode_gray(a, 1);
  const auto image_b = codec.decode_gray(b, 1);
  if (!image_a || !image_b) return 0;
  double error = 0;
  for (std::size_t i = 0; i < image_a.value().pixels.size(); ++i) {
    error += std::pow(image_a.value().pixels[i] - image_b.value().pixels[i], 2);
  }
  const auto count = static_cast<double>(image_a.value().pixels.size());
  return error == 0 ? std::numeric_limits<double>::infinity()
                    : 10 * std::log10(255.0 * 255.0 * count / error);
}

std::string error_of(const Bytes& jpeg, int quality = 30) {
  const auto reduced = Requantiser().reduce(frame_of(jpeg), quality);
  return reduced ? "" : reduced.error().text;
}

/// What holds for every image: smaller, as good as one encoded so from the start, as the source is.
void expect_reduced(const Encoding& encoding, int quality) {
  const Bytes whole = encoded(encoding);
  const auto reduced = Requantiser().reduce(frame_of(whole), quality);
  ASSERT_TRUE(reduced) << reduced.error().text;
  const Bytes& jpeg = reduced.value().jpeg;
  EXPECT_LT(jpeg.size(), whole.size());

  Encoding reference{.quality = 100, .is_color = encoding.is_color, .columns = 1, .rows = 1};
  const Bytes pixels = encoded(reference);
  Encoding direct = encoding;
  direct.quality = quality;
  EXPECT_GT(likeness(jpeg, pixels), likeness(encoded(direct), pixels) - 0.6);

  const Head before = head_of(whole);
  const Head after = head_of(jpeg);
  EXPECT_EQ(after.color_space, before.color_space);
  EXPECT_EQ(after.sampling, before.sampling);
  EXPECT_EQ(after.restart_interval, before.restart_interval);
  EXPECT_EQ(after.markers, before.markers);
  EXPECT_FALSE(after.is_progressive);
  const Head asked = head_of(encoded(direct));
  for (std::size_t i = 0; i < before.steps.size(); ++i) {
    for (std::size_t j = 0; j < DCTSIZE2; ++j) {
      EXPECT_EQ(after.steps[i][j], std::max(before.steps[i][j], asked.steps[i][j]));
    }
  }
}

TEST(Requantiser, AGrayImageBecomesAsOneEncodedSoFromTheStart) {
  for (const int quality : {50, 30, 20, 10, 1}) expect_reduced({.is_color = false}, quality);
}

TEST(Requantiser, AColourImageKeepsItsSubsampling) {
  for (const auto& [columns, rows] : {std::pair(2, 2), {2, 1}, {1, 1}, {1, 2}, {4, 1}}) {
    expect_reduced({.columns = columns, .rows = rows}, 30);
  }
}

TEST(Requantiser, RestartIntervalsAreKept) {
  expect_reduced({.is_color = false, .restart_interval = 5}, 30);
  expect_reduced({.restart_interval = 3}, 30);
}

TEST(Requantiser, AProgressiveImageBecomesASequentialOne) {
  expect_reduced({.is_progressive = true}, 30);
  expect_reduced({.is_color = false, .is_progressive = true}, 30);
}

TEST(Requantiser, WhatLibjpegReadsBesidesIsReducedToo) {
  expect_reduced({.has_one_table = true}, 30);
  expect_reduced({.has_one_scan_each = true}, 30);
}

TEST(Requantiser, MetadataAreKept) {
  expect_reduced({.comment = "a comment", .app = std::string("Exif\0\0 and more", 15)}, 30);
  expect_reduced({.app = std::string(65533, 'x')}, 30);
}

TEST(Requantiser, ACamerasJpegIsReducedOnceItHasItsHuffmanTables) {
  Bytes jpeg = encoded({.columns = 2, .rows = 1});
  for (auto at = jpeg.begin() + 2; at[1] != 0xDA;) {
    const auto end = at + 2 + std::ptrdiff_t{at[2]} * 256 + at[3];
    at = at[1] == 0xC4 || at[1] == 0xE0 ? jpeg.erase(at, end) : end;  // nor JFIF's header
  }
  const Bytes whole = with_standard_head(jpeg);
  const auto reduced = Requantiser().reduce(frame_of(whole), 30);
  ASSERT_TRUE(reduced) << reduced.error().text;
  EXPECT_TRUE(head_of(reduced.value().jpeg).markers.empty());
  EXPECT_GT(likeness(reduced.value().jpeg, whole), 30);
}

TEST(Requantiser, AFrameKeepsAllButItsJpegAndNamesTheOneItWasMadeFrom) {
  const EncodedFrame whole = frame_of(encoded({}));
  Requantiser requantiser;
  const auto half = requantiser.reduce(whole, 50);
  ASSERT_TRUE(half);
  const auto less = requantiser.reduce(half.value(), 20);
  ASSERT_TRUE(less);
  for (const EncodedFrame& frame : {half.value(), less.value()}) {
    EXPECT_EQ(frame.sequence, whole.sequence);
    EXPECT_EQ(frame.capture_time_ns, whole.capture_time_ns);
    EXPECT_EQ(frame.exposure_ns, whole.exposure_ns);
    EXPECT_EQ(frame.width_px, whole.width_px);
    EXPECT_EQ(frame.height_px, whole.height_px);
    EXPECT_EQ(frame.left_bytes, frame.jpeg.size());
    EXPECT_EQ(frame.jpeg_crc, wire::crc32(frame.jpeg));
    EXPECT_EQ(frame.whole_bytes, whole.jpeg.size());
    EXPECT_EQ(frame.whole_crc, whole.jpeg_crc);
    EXPECT_FALSE(frame.is_stereo());
  }
  EXPECT_EQ(half.value().quality, 50);
  EXPECT_EQ(less.value().quality, 20);
}

TEST(Requantiser, BothImagesOfAStereoFrameAreReduced) {
  const Bytes left = encoded({.is_color = false});
  const Bytes right = encoded({.quality = 85, .is_color = false, .restart_interval = 4});
  Bytes both = left;
  both.insert(both.end(), right.begin(), right.end());
  EncodedFrame whole = frame_of(both);
  whole.left_bytes = static_cast<std::uint32_t>(left.size());
  const auto reduced = Requantiser().reduce(whole, 30);
  ASSERT_TRUE(reduced) << reduced.error().text;
  const EncodedFrame& frame = reduced.value();
  ASSERT_TRUE(frame.is_stereo());
  EXPECT_THAT(frame.left(),
              testing::ElementsAreArray(Requantiser().reduce(frame_of(left), 30).value().jpeg));
  EXPECT_THAT(frame.right(),
              testing::ElementsAreArray(Requantiser().reduce(frame_of(right), 30).value().jpeg));
  EXPECT_EQ(frame.whole_bytes, both.size());

  whole.jpeg.resize(whole.jpeg.size() - 100);
  EXPECT_FALSE(Requantiser().reduce(whole, 30));
}

TEST(Requantiser, QualityIsClamped) {
  const EncodedFrame whole = frame_of(encoded({}));
  const auto lowest = Requantiser().reduce(whole, -5);
  ASSERT_TRUE(lowest);
  EXPECT_EQ(lowest.value().quality, 1);
  EXPECT_EQ(lowest.value().jpeg, Requantiser().reduce(whole, 1).value().jpeg);
  EXPECT_THAT(error_of(whole.jpeg, 1000), HasSubstr("to quality 100: it is of no higher quality"));
}

TEST(Requantiser, AnImageOfThatQualityOrOfALowerOneIsAnError) {
  for (const int quality : {20, 30}) {
    EXPECT_THAT(error_of(encoded({.quality = quality})),
                HasSubstr("to quality 30: it is of no higher quality"));
  }
}

TEST(Requantiser, AnImageThatWouldGrowIsAnError) {
  EXPECT_THAT(error_of(encoded({.quality = 31, .is_color = false, .has_best_code = true})),
              HasSubstr("it would not become smaller"));
}

TEST(Requantiser, ATruncatedImageIsAnErrorAndDoesNotAffectTheNext) {
  Requantiser requantiser;
  for (const bool is_progressive : {false, true}) {
    const Bytes whole = encoded({.restart_interval = 8, .is_progressive = is_progressive});
    const Bytes good = Requantiser().reduce(frame_of(whole), 30).value().jpeg;
    for (std::size_t size = 0; size + 2 < whole.size(); size += size < 700 ? 1 : 53) {
      const auto cut = requantiser.reduce(
          frame_of({whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)}), 30);
      ASSERT_FALSE(cut) << size;
      Bytes ended(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      ended.insert(ended.end(), {0xFF, 0xD9});  // components may have no scan
      ASSERT_FALSE(requantiser.reduce(frame_of(ended), 30)) << size;
    }
    EXPECT_EQ(requantiser.reduce(frame_of(whole), 30).value().jpeg, good);
  }
}

TEST(Requantiser, WhatDecodersPassOverIsGoneAfterwards) {
  const Bytes whole = test::restart_jpeg(kWidth, kHeight, true, 0);
  const Bytes good = Requantiser().reduce(frame_of(whole), 30).value().jpeg;
  const Bytes with_spare = test::restart_jpeg(kWidth, kHeight, true, 3);
  EXPECT_EQ(Requantiser().reduce(frame_of(with_spare), 30).value().jpeg, good);
  const Bytes with_zeros = test::with_zeros_in_head(whole, 600);
  EXPECT_EQ(Requantiser().reduce(frame_of(with_zeros), 30).value().jpeg, good);
  const Bytes without_end(whole.begin(), whole.end() - 2);
  EXPECT_EQ(Requantiser().reduce(frame_of(without_end), 30).value().jpeg, good);
  EXPECT_THAT(error_of(test::restart_jpeg(kWidth, kHeight, true, 5)),
              HasSubstr("extraneous bytes before marker"));
}

TEST(Requantiser, ACorruptImageIsAnErrorOrStaysAnImage) {
  Requantiser requantiser;
  JpegCodec codec;
  std::uint32_t random = 1;
  testing::internal::CaptureStderr();
  for (const bool is_progressive : {false, true}) {
    const Bytes whole = encoded({.restart_interval = 8, .is_progressive = is_progressive});
    const Bytes good = Requantiser().reduce(frame_of(whole), 30).value().jpeg;
    for (std::size_t at = 0; at < whole.size(); at += at < 700 ? 1 : 11) {
      random = random * 1664525 + 1013904223;
      Bytes broken = whole;
      broken[at] ^= static_cast<std::uint8_t>(1U + random % 255U);
      const auto reduced = requantiser.reduce(frame_of(broken), 30);
      EXPECT_TRUE(!reduced || codec.decode_gray(reduced.value().jpeg, 8)) << at;
      ASSERT_EQ(requantiser.reduce(frame_of(whole), 30).value().jpeg, good) << at;
    }
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(Requantiser, AnImageThatClaimsTooManyPixelsIsAnError) {
  Bytes jpeg = encoded({.is_color = false});
  const std::array<std::uint8_t, 2> frame = {0xFF, 0xC0};
  const auto at = std::search(jpeg.begin(), jpeg.end(), frame.begin(), frame.end());
  ASSERT_NE(at, jpeg.end());
  std::fill_n(at + 5, 4, std::uint8_t{0x7F});  // its height and width
  EXPECT_THAT(error_of(jpeg), HasSubstr("pixels are over the limit of"));
}

TEST(Requantiser, AnImageOfTooManyScansIsAnError) {
  const Bytes jpeg = encoded({.has_one_scan_each = true});
  const std::array<std::uint8_t, 2> scan = {0xFF, 0xDA};
  const auto last = std::find_end(jpeg.begin(), jpeg.end(), scan.begin(), scan.end());
  const Bytes again(last, jpeg.end() - 2);
  for (const int times : {400, 600}) {
    Bytes many(jpeg.begin(), jpeg.end() - 2);
    for (int i = 0; i < times; ++i) many.insert(many.end(), again.begin(), again.end());
    many.insert(many.end(), jpeg.end() - 2, jpeg.end());
    EXPECT_EQ(error_of(many).find("it has too many scans") != std::string::npos, times > 500);
  }
}

/// An image of one gray block with this, of at most 15 bits, as its first coefficient beside DC,
/// and 200 bytes of tables that nothing uses, so that it can become smaller. No encoder makes it.
Bytes with_coefficient(int value) {
  const unsigned magnitude = static_cast<unsigned>(std::abs(value));
  const unsigned size = static_cast<unsigned>(std::bit_width(magnitude));
  Bytes jpeg = {0xFF, 0xD8, 0xFF, 0xDB, 0, 67, 0};
  jpeg.insert(jpeg.end(), DCTSIZE2, 4);  // steps
  jpeg.insert(jpeg.end(), {0xFF, 0xC0, 0, 11, 8, 0, 8, 0, 8, 1, 1, 0x11, 0});
  const auto add_code = [&](std::uint8_t table, unsigned bits, const Bytes& symbols) {
    jpeg.insert(jpeg.end(), {0xFF, 0xC4, 0, static_cast<std::uint8_t>(19 + symbols.size()), table});
    for (unsigned i = 1; i <= 16; ++i) {
      jpeg.push_back(i == bits ? static_cast<std::uint8_t>(symbols.size()) : 0);
    }
    jpeg.insert(jpeg.end(), symbols.begin(), symbols.end());
  };
  add_code(0x00, 1, {0});                                   // DC: 0
  add_code(0x10, 2, {0, static_cast<std::uint8_t>(size)});  // AC: 00 ends, 01 is `value`
  for (int unused = 0x11; unused <= 0x13; ++unused) {
    add_code(static_cast<std::uint8_t>(unused), 16, Bytes(200));
  }
  jpeg.insert(jpeg.end(), {0xFF, 0xDA, 0, 8, 1, 1, 0, 0, 63, 0});
  // 0, 01, the value, 00, then ones to the end of the byte.
  const unsigned coded = value < 0 ? ~magnitude & ((1U << size) - 1U) : magnitude;
  std::uint32_t bits = (1U << size | coded) << 2U;  // of which there are 5 and size
  for (unsigned count = size + 5; count < 32; ++count) bits = bits << 1U | 1U;
  for (unsigned at = 0; at < (size + 12) / 8; ++at) {
    jpeg.push_back(static_cast<std::uint8_t>(bits >> (24U - 8U * at)));
    if (jpeg.back() == 0xFF) jpeg.push_back(0);
  }
  jpeg.insert(jpeg.end(), {0xFF, 0xD9});
  return jpeg;
}

TEST(Requantiser, ACoefficientThatBaselineCannotSayIsAnError) {
  for (const int sign : {1, -1}) {  // the step is 4, and 11 at quality 50
    const auto error = [&](int value) { return error_of(with_coefficient(sign * value), 50); };
    EXPECT_EQ(error(1023), "");
    EXPECT_EQ(error(2800), "");
    for (const int value : {3000, 5000, 20000, 32767}) {
      EXPECT_THAT(error(value), HasSubstr("a coefficient is out of range"));
    }
  }
}

}  // namespace
}  // namespace orbbuf

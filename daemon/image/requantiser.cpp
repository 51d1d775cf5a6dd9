// SPDX-License-Identifier: Apache-2.0
#include "daemon/image/requantiser.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cstddef>

#include "common/libjpeg.hpp"
#include "common/wire.hpp"

namespace orbbuf {
namespace {

/// Codes for what is left after requantising; the standard ones (ITU-T T.81, annex K.3) are made
/// for finer steps. `counts`: codes of 1 bit, of 2, ... of 16. `first`: the symbols in the order of
/// their codes; all others follow in the order of their numbers. A symbol is a run of zeros (0 to
/// 15) and the size in bits (1 to 10) of the coefficient after it, or just a size (0 to 11) for DC.
/// Optimal, up to 16 bits, for 40 frames of each of the four recorded sequences, gray and where
/// they have it in colour, from quality 80 to 50, 30 and 20 (weights 1, 2, 2), with 2 % of what the
/// standard codes are optimal for. docs/measurements.md has what they save.
struct HuffmanCode {
  std::array<UINT8, 16> counts;
  std::span<const UINT8> first;
};
constexpr std::array<UINT8, 12> kDcFirst = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
constexpr std::array<UINT8, 53> kAcLumaFirst = {
    0x00, 0x01, 0x02, 0x03, 0x11, 0x21, 0x12, 0x31, 0x04, 0x41, 0x51, 0x05, 0x13, 0x22,
    0x32, 0x61, 0x71, 0x52, 0x81, 0x91, 0x14, 0x23, 0x33, 0x42, 0xA1, 0x06, 0x62, 0x72,
    0xB1, 0x15, 0x34, 0x53, 0xC1, 0x24, 0x43, 0x82, 0x92, 0xD1, 0xF0, 0x07, 0x35, 0xE1,
    0x25, 0x44, 0x54, 0x63, 0xA2, 0xF1, 0x08, 0x16, 0x73, 0x93, 0xB2};
constexpr std::array<UINT8, 33> kAcChromaFirst = {
    0x00, 0x01, 0x11, 0x02, 0x12, 0x31, 0x03, 0x21, 0x41, 0x51, 0x04,
    0x05, 0x13, 0x22, 0x32, 0x06, 0x61, 0x71, 0x07, 0x42, 0x81, 0x14,
    0x08, 0x23, 0x33, 0x52, 0x91, 0xA1, 0xB1, 0xC1, 0xF0, 0x09, 0xD1};
constexpr HuffmanCode kDcLuma{{0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1}, kDcFirst};
constexpr HuffmanCode kDcChroma{{1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1}, kDcFirst};
constexpr HuffmanCode kAcLuma{{0, 2, 1, 3, 2, 3, 6, 3, 5, 4, 4, 5, 4, 6, 5, 109}, kAcLumaFirst};
constexpr HuffmanCode kAcChroma{{1, 1, 1, 1, 0, 2, 2, 1, 1, 5, 3, 3, 1, 8, 3, 129}, kAcChromaFirst};

/// libjpeg reads as many symbols as there are codes, so for DC none of those of AC.
void set_code(const HuffmanCode& code, JHUFF_TBL& table) {
  std::copy(code.counts.begin(), code.counts.end(), table.bits + 1);
  UINT8* end = std::copy(code.first.begin(), code.first.end(), table.huffval);
  for (unsigned symbol = 0; symbol < 256; ++symbol) {
    const unsigned size = symbol % 16;
    const bool is_used = size == 0 ? symbol == 0x00 || symbol == 0xF0 : size <= 10;
    const auto value = static_cast<UINT8>(symbol);
    if (is_used && std::find(code.first.begin(), code.first.end(), value) == code.first.end()) {
      *end++ = value;
    }
  }
}

/// A number for each coefficient of a block.
using Block = std::array<std::uint16_t, DCTSIZE2>;

/// 65536 * old step / new step, at most 65535.
Block ratios_of(const JQUANT_TBL& from, const JQUANT_TBL& to) {
  Block ratios{};
  for (std::size_t i = 0; i < DCTSIZE2; ++i) {
    ratios[i] =
        static_cast<std::uint16_t>(std::min(65536U * from.quantval[i] / to.quantval[i], 65535U));
  }
  return ratios;
}

/// In 1/16 of a new step, what is added before the fraction is cut off. Less than half of a step:
/// within its old step a coefficient is more often nearer to zero. Measured against 8: 10 % fewer
/// bytes at quality 30. Not for DC, which would change the brightness.
constexpr Block kRounding = [] {
  Block rounding{};
  rounding.fill(7);
  rounding[0] = 8;
  return rounding;
}();

/// Divides and rounds; exact where the step stays. Adds the bits of the results to `seen`: more
/// than 1023 there means that a result cannot be coded, or that a coefficient is too large for 16
/// times itself, which no encoder's is. For the compiler's vectors: 16 bits wide, without a branch.
void requantise(JCOEF* __restrict block, const Block& __restrict ratios, Block& __restrict seen) {
  for (std::size_t i = 0; i < DCTSIZE2; ++i) {
    const JCOEF value = block[i];
    const auto magnitude = static_cast<std::uint16_t>(value < 0 ? -value : value);
    const auto shifted = static_cast<std::uint16_t>(magnitude << 4U);
    const auto sixteenths = static_cast<std::uint16_t>((std::uint32_t{shifted} * ratios[i]) >> 16U);
    const auto sum = static_cast<std::uint16_t>(sixteenths + kRounding[i]);
    const auto rounded = static_cast<std::uint16_t>(sum >> 4U);
    seen[i] |= static_cast<std::uint16_t>(rounded | (magnitude & 0xF000U));
    block[i] = static_cast<JCOEF>(value < 0 ? -rounded : rounded);
  }
}

}  // namespace

/// Decides and writes with libjpeg; each function between run() and libjpeg as libjpeg.hpp says.
struct Requantiser::State {
  /// libjpeg.written() is the JPEG then. False after an error, which is in libjpeg.why.
  bool reduce(std::span<const std::uint8_t> jpeg, int quality);

  void set_steps(int quality);
  void requantise_all(jvirt_barray_ptr* coefficients);

  Libjpeg libjpeg{"reducer"};
  jpeg_decompress_struct& in = libjpeg.in;
  jpeg_compress_struct& out = libjpeg.out;
};

bool Requantiser::State::reduce(std::span<const std::uint8_t> jpeg, int quality) {
  return libjpeg.run([&] {
    libjpeg.read_header(jpeg);
    jvirt_barray_ptr* const coefficients = jpeg_read_coefficients(&in);
    jpeg_copy_critical_parameters(&in, &out);
    set_steps(quality);
    requantise_all(coefficients);
    out.restart_interval = in.restart_interval;
    set_code(kDcLuma, *out.dc_huff_tbl_ptrs[0]);
    set_code(kDcChroma, *out.dc_huff_tbl_ptrs[1]);
    set_code(kAcLuma, *out.ac_huff_tbl_ptrs[0]);
    set_code(kAcChroma, *out.ac_huff_tbl_ptrs[1]);
    libjpeg.write(coefficients);
    libjpeg.finish_reading();
  });
}

/// From the last component to the first: a table that luma and chroma share is made for luma.
void Requantiser::State::set_steps(int quality) {
  for (int i = 0; i < in.num_components; ++i) {
    if (in.comp_info[i].quant_table == nullptr) libjpeg.fail("a component has no scan");
  }
  jpeg_set_quality(&out, quality, TRUE);
  const std::array<JQUANT_TBL, 2> standard = {*out.quant_tbl_ptrs[0], *out.quant_tbl_ptrs[1]};
  bool is_coarser = false;
  for (int i = in.num_components - 1; i >= 0; --i) {
    const JQUANT_TBL& least = standard[i == 0 ? 0 : 1];
    const JQUANT_TBL& old = *in.comp_info[i].quant_table;
    JQUANT_TBL& steps = *out.quant_tbl_ptrs[in.comp_info[i].quant_tbl_no];
    for (int j = 0; j < DCTSIZE2; ++j) {
      steps.quantval[j] = std::max(old.quantval[j], least.quantval[j]);
      is_coarser = is_coarser || steps.quantval[j] > old.quantval[j];
    }
  }
  if (!is_coarser) libjpeg.fail("it is of no higher quality");
}

void Requantiser::State::requantise_all(jvirt_barray_ptr* coefficients) {
  Block seen{};
  for (int i = 0; i < in.num_components; ++i) {
    const jpeg_component_info& component = in.comp_info[i];
    const Block ratios =
        ratios_of(*component.quant_table, *out.quant_tbl_ptrs[component.quant_tbl_no]);
    for (JDIMENSION row = 0; row < component.height_in_blocks; ++row) {
      auto* const rows = in.mem->access_virt_barray(reinterpret_cast<j_common_ptr>(&in),
                                                    coefficients[i], row, 1, TRUE);
      for (JDIMENSION column = 0; column < component.width_in_blocks; ++column) {
        requantise(rows[0][column], ratios, seen);
      }
    }
  }
  // libjpeg's vector code would write codes that do not exist.
  if (std::any_of(seen.begin(), seen.end(), [](unsigned value) { return value > 1023; })) {
    libjpeg.fail("a coefficient is out of range");
  }
}

Requantiser::Requantiser() : state_(std::make_unique<State>()) {}

Requantiser::~Requantiser() = default;

Result<EncodedFrame> Requantiser::reduce(const EncodedFrame& whole, int quality) {
  quality = std::clamp(quality, 1, 100);
  EncodedFrame reduced = whole;
  reduced.jpeg.clear();
  for (std::size_t i = 0; i < (whole.is_stereo() ? 2 : 1); ++i) {
    const bool is_done = state_->reduce(i == 0 ? whole.left() : whole.right(), quality);
    const auto jpeg = state_->libjpeg.written();
    if (!is_done || reduced.jpeg.size() + jpeg.size() >= whole.jpeg.size()) {
      return Error{fmt::format(
          "cannot reduce a JPEG of {} bytes to quality {}: {}", whole.jpeg.size(), quality,
          is_done ? "it would not become smaller" : state_->libjpeg.why.data())};
    }
    reduced.jpeg.insert(reduced.jpeg.end(), jpeg.begin(), jpeg.end());
    if (i == 0) reduced.left_bytes = static_cast<std::uint32_t>(jpeg.size());
  }
  reduced.jpeg_crc = wire::crc32(reduced.jpeg);
  reduced.quality = static_cast<std::uint8_t>(quality);
  if (!whole.is_reduced()) {
    reduced.whole_bytes = static_cast<std::uint32_t>(whole.jpeg.size());
    reduced.whole_crc = whole.jpeg_crc;
  }
  return reduced;
}

}  // namespace orbbuf

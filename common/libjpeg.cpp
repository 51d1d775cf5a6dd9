// SPDX-License-Identifier: Apache-2.0
#include "common/libjpeg.hpp"

#include <fmt/format.h>
#include <jerror.h>

#include <algorithm>
#include <new>
#include <stdexcept>
#include <utility>

#include "common/jpeg.hpp"
#include "common/log.hpp"

namespace orbbuf {
namespace {

constexpr int kMaxScans = 500;  // of a progressive JPEG: a small file can ask for hours

Libjpeg& self_of(void* client_data) { return *static_cast<Libjpeg*>(client_data); }

}  // namespace

Libjpeg::Libjpeg(std::string owner) : owner_(std::move(owner)) {
  jpeg_std_error(&errors_);
  errors_.error_exit = [](j_common_ptr info) {
    Libjpeg& self = self_of(info->client_data);
    Text text{};
    info->err->format_message(info, text.data());
    // Behind the end of the data libjpeg reads what it makes up: the end is the reason.
    self.fail("{}", self.has_no_end_ ? self.repair.data() : text.data());
  };
  errors_.emit_message = [](j_common_ptr info, int level) {
    Libjpeg& self = self_of(info->client_data);
    if (level < 0) self.judge_warning();
    if (self.errors_.msg_code == JTRC_RST) ++self.markers_;
  };
  progress_.progress_monitor = [](j_common_ptr info) {
    Libjpeg& self = self_of(info->client_data);
    if (self.in.input_scan_number > kMaxScans) self.fail("it has too many scans");
  };
  destination_.init_destination = [](j_compress_ptr info) {
    Libjpeg& self = self_of(info->client_data);
    self.destination_.free_in_buffer = self.output_.size();
    self.destination_.next_output_byte = self.output_.data();
    if (self.output_.empty()) self.add_room();
  };
  destination_.empty_output_buffer = [](j_compress_ptr info) -> boolean {
    self_of(info->client_data).add_room();
    return TRUE;
  };
  destination_.term_destination = [](j_compress_ptr) {};
  in.err = out.err = &errors_;
  in.client_data = out.client_data = this;
  if (setjmp(on_error_) != 0) {
    throw std::runtime_error(fmt::format("cannot set up libjpeg: {}", why.data()));
  }
  jpeg_create_decompress(&in);
  jpeg_create_compress(&out);
  in.progress = &progress_;
  out.dest = &destination_;
  jpeg_save_markers(&in, JPEG_COM, 0xFFFF);
  for (int i = 0; i < 16; ++i) jpeg_save_markers(&in, JPEG_APP0 + i, 0xFFFF);
}

Libjpeg::~Libjpeg() {
  jpeg_destroy_decompress(&in);
  jpeg_destroy_compress(&out);
  if (repaired > 1 && !owner_.empty()) log_info("{}: repaired {} JPEGs", owner_, repaired);
}

void Libjpeg::jump(fmt::string_view format, fmt::format_args values) {
  *fmt::vformat_to_n(why.data(), why.size() - 1, format, values).out = '\0';
  std::longjmp(on_error_, 1);  // not an exception: libjpeg may be built without tables to unwind it
}

void Libjpeg::reset() {
  jpeg_abort_decompress(&in);
  jpeg_abort_compress(&out);
}

void Libjpeg::judge_warning() {
  const int code = errors_.msg_code;
  bool is_passed = code == JWRN_JFIF_MAJOR || code == JWRN_JPEG_EOF;
  if (code == JWRN_EXTRANEOUS_DATA) {  // its number is that of all markers since the last one
    is_passed = !is_in_scan_ || errors_.msg_parm.i[0] <= kMostSpareBytes * std::max(markers_, 1);
    markers_ = 0;
  }
  const auto info = reinterpret_cast<j_common_ptr>(&in);
  if (!is_passed) errors_.error_exit(info);
  if (code == JWRN_JPEG_EOF) has_no_end_ = true;
  if (code == JWRN_JPEG_EOF || repair[0] == '\0') errors_.format_message(info, repair.data());
}

void Libjpeg::count_repair() {
  if (repair[0] == '\0' || ++repaired > 1 || owner_.empty()) return;
  log_warn("{}: repaired a JPEG: {} (further ones are counted, and not logged)", owner_,
           repair.data());
}

/// Doubles the output.
void Libjpeg::add_room() {
  constexpr std::size_t kLeast = 65536;
  const std::size_t before = output_.size();
  try {
    output_.resize(std::max(2 * before, kLeast));
  } catch (const std::bad_alloc&) {
    output_ = {};
  }
  if (output_.empty()) fail("out of memory");
  destination_.next_output_byte = output_.data() + before;
  destination_.free_in_buffer = output_.size() - before;
}

void Libjpeg::read_header(std::span<const std::uint8_t> jpeg) {
  is_in_scan_ = has_no_end_ = false;
  jpeg_mem_src(&in, jpeg.data(), static_cast<unsigned long>(jpeg.size()));
  jpeg_read_header(&in, TRUE);
  is_in_scan_ = true;
  markers_ = 1;
  if (in.data_precision != 8) fail("it has {} bits a sample, not 8", in.data_precision);
  if (in.arith_code != 0) fail("it has arithmetic codes; only Huffman codes are read");
  if (in.jpeg_color_space != JCS_GRAYSCALE && in.jpeg_color_space != JCS_YCbCr) {
    fail("it is neither gray nor YCbCr, and has {} components", in.num_components);
  }
  if (std::int64_t{in.image_width} * in.image_height > kMaxJpegPixels) {
    fail("{}x{} pixels are over the limit of {} pixels", in.image_width, in.image_height,
         kMaxJpegPixels);
  }
}

/// Without an end marker the data may end between two scans, where libjpeg misses nothing.
void Libjpeg::finish_reading() {
  for (int i = 0; has_no_end_ && i < in.num_components; ++i) {
    const bool is_whole =
        in.comp_info[i].quant_table != nullptr &&
        (in.coef_bits == nullptr ||
         std::all_of(in.coef_bits[i], in.coef_bits[i] + DCTSIZE2, [](int b) { return b == 0; }));
    if (!is_whole) fail("{}", repair.data());
  }
  jpeg_finish_decompress(&in);
}

void Libjpeg::write(jvirt_barray_ptr* coefficients) {
  out.write_JFIF_header = out.write_Adobe_marker = FALSE;  // they are among the markers
  jpeg_write_coefficients(&out, coefficients);
  for (auto* marker = in.marker_list; marker != nullptr; marker = marker->next) {
    jpeg_write_marker(&out, marker->marker, marker->data, marker->data_length);
  }
  jpeg_finish_compress(&out);
}

}  // namespace orbbuf

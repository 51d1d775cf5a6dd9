// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/core.h>

#include <array>
#include <csetjmp>
#include <cstddef>
#include <cstdint>
#include <cstdio>  // which jpeglib.h needs and does not include
#include <span>
#include <string>
#include <vector>

extern "C" {
#include <jpeglib.h>
}

namespace orbbuf {

/// libjpeg's two objects, and the one place that decides which JPEGs are read: those with 8 bits a
/// sample and Huffman codes, gray or YCbCr. A warning of libjpeg is an error, since pixels are
/// missing or corrupt. These warnings cost no pixel in any decoder, and the JPEG is passed and
/// counted as repaired:
///
///   JWRN_JFIF_MAJOR       a JFIF version that libjpeg does not know
///   JWRN_EXTRANEOUS_DATA  bytes between the segments of the head; from the first scan on, at most
///                         kMostSpareBytes before a marker: more are the rest of corrupt data
///   JWRN_JPEG_EOF         no end marker, but all rows
///
/// libjpeg reports an error by a jump to run(), past the functions between: none of them may own an
/// object with a destructor. Thread-bound.
struct Libjpeg {
  using Text = std::array<char, JMSG_LENGTH_MAX>;
  static constexpr int kMostSpareBytes = 4;

  /// Logs the first JPEG that is repaired, and at the end how many were, as of `owner`; nothing if
  /// that is empty. Throws std::runtime_error if libjpeg cannot be set up.
  explicit Libjpeg(std::string owner);
  ~Libjpeg();
  Libjpeg(const Libjpeg&) = delete;
  Libjpeg& operator=(const Libjpeg&) = delete;

  /// Calls `work`, which may call all below. Returns false after an error, which `why` says. An
  /// error does not affect the next call.
  template <class Work>
  bool run(const Work& work) {
    reset();
    repair[0] = '\0';
    if (setjmp(on_error_) != 0) {
      reset();
      return false;
    }
    work();
    count_repair();
    return true;
  }

  template <class... Values>
  [[noreturn]] void fail(fmt::format_string<Values...> format, Values&&... values) {
    jump(format, fmt::make_format_args(values...));
  }

  /// Up to the first scan. `jpeg` must stay until it is read.
  void read_header(std::span<const std::uint8_t> jpeg);
  /// Once all rows or coefficients are read: reads the rest.
  void finish_reading();

  /// Writes a JPEG of `coefficients` with the markers of `in`.
  void write(jvirt_barray_ptr* coefficients);
  /// What was written; valid until more is.
  std::span<const std::uint8_t> written() const {
    return std::span(output_).first(output_.size() - destination_.free_in_buffer);
  }

  jpeg_decompress_struct in{};
  jpeg_compress_struct out{};
  Text why{};
  Text repair{};  ///< of this JPEG; empty: none
  std::uint64_t repaired = 0;

 private:
  [[noreturn]] void jump(fmt::string_view format, fmt::format_args values);
  void reset();
  void judge_warning();
  void count_repair();
  void add_room();

  const std::string owner_;
  jpeg_error_mgr errors_{};
  jpeg_progress_mgr progress_{};
  jpeg_destination_mgr destination_{};
  std::jmp_buf on_error_{};
  bool is_in_scan_ = false;
  int markers_ = 1;  // restart markers since spare bytes were counted, and the next marker
  bool has_no_end_ = false;
  std::vector<std::uint8_t> output_;
};

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>

namespace orbbuf {

/// A driver's buffer in this process's memory, to be read, from construction to destruction.
class BufferMapping {
 public:
  /// mmap(2); if it fails errno says why, and the mapping is false.
  BufferMapping(int fd, std::int64_t offset, std::size_t size)
      : begin_(::mmap(nullptr, size, PROT_READ, MAP_SHARED, fd, offset)), size_(size) {}
  BufferMapping(BufferMapping&& other) noexcept
      : begin_(std::exchange(other.begin_, MAP_FAILED)), size_(other.size_) {}
  BufferMapping& operator=(BufferMapping&&) = delete;
  ~BufferMapping() {
    if (*this) ::munmap(begin_, size_);
  }

  explicit operator bool() const { return begin_ != MAP_FAILED; }
  std::span<const std::uint8_t> bytes() const {
    return {static_cast<const std::uint8_t*>(begin_), size_};
  }

 private:
  void* begin_;
  std::size_t size_;
};

}  // namespace orbbuf

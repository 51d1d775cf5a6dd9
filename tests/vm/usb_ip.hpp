// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "common/unique_fd.hpp"

namespace orbbuf::vm {

using Bytes = std::vector<std::uint8_t>;

/// A transfer that the kernel asks a USB device for.
struct UsbRequest {
  std::uint32_t number = 0;
  std::uint32_t endpoint = 0;  ///< 0: control
  bool is_in = false;          ///< the device is to answer with data
  std::size_t length = 0;      ///< bytes that the kernel has, or has room for
  std::array<std::uint8_t, 8> setup{};
  Bytes data;  ///< what the kernel sent
};

/// A high-speed USB device plugged into the kernel's virtual host controller (vhci-hcd) by the
/// USB/IP protocol, for as long as this object, or its process, lives: then it is unplugged. The
/// protocol is in the kernel's Documentation/usb/usbip_protocol.rst.
class UsbIpPort {
 public:
  /// Throws std::runtime_error if it cannot be plugged in: no vhci-hcd, not root, port 0 in use.
  UsbIpPort();

  /// The next control transfer; nothing if none comes within `patience`. Transfers of data wait in
  /// waiting() until they are answered or the kernel takes them back. Throws at the end of the
  /// line.
  std::optional<UsbRequest> next_control(std::chrono::nanoseconds patience);

  /// The oldest transfer of data waits to be answered.
  bool is_asked() const { return !waiting_.empty(); }
  std::size_t asked_bytes() const { return waiting_.front().length; }
  void answer_oldest(std::span<const std::uint8_t> data);

  /// status: 0 or a negative errno value. What went out counts as taken.
  void answer(const UsbRequest& request, std::span<const std::uint8_t> data, int status);

 private:
  std::optional<UsbRequest> read_message();
  void withdraw(std::uint32_t message, std::uint32_t request);
  void read(void* into, std::size_t bytes) const;
  void write(std::span<const std::uint8_t> bytes) const;

  UniqueFd line_;
  std::deque<UsbRequest> waiting_;
};

}  // namespace orbbuf::vm

// SPDX-License-Identifier: Apache-2.0
#include "tests/vm/usb_ip.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/core.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "common/error.hpp"

namespace orbbuf::vm {
namespace {

constexpr const char* kAttach = "/sys/devices/platform/vhci_hcd.0/attach";
constexpr std::uint32_t kHighSpeed = 3;
constexpr std::uint32_t kDevice = 1U << 16 | 2;  // bus 1, device 2

constexpr std::uint32_t kSubmit = 1;
constexpr std::uint32_t kUnlink = 2;
constexpr std::uint32_t kSubmitted = 3;
constexpr std::uint32_t kUnlinked = 4;

/// 48 bytes, the words in network byte order; their meaning depends on the first.
using Words = std::array<std::uint32_t, 12>;
enum Word : std::size_t { kCommand, kNumber, kWhere, kDirection, kEndpoint, kFifth, kSixth };

std::span<const std::uint8_t> bytes_of(const Words& words) {
  return {reinterpret_cast<const std::uint8_t*>(words.data()), sizeof(words)};
}

}  // namespace

UsbIpPort::UsbIpPort() {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) != 0) throw_system_error("socketpair");
  const UniqueFd kernels(ends[0]);
  line_ = UniqueFd(ends[1]);
  const UniqueFd attach(::open(kAttach, O_WRONLY));
  if (!attach) throw_system_error(fmt::format("cannot open {}", kAttach));
  const auto plug = fmt::format("0 {} {} {}", kernels.get(), kDevice, kHighSpeed);
  if (::write(attach.get(), plug.data(), plug.size()) < 0) throw_system_error("cannot plug in");
}

std::optional<UsbRequest> UsbIpPort::next_control(std::chrono::nanoseconds patience) {
  using std::chrono::milliseconds;
  const auto wait = std::chrono::ceil<milliseconds>(std::max(patience, std::chrono::nanoseconds()));
  pollfd event{line_.get(), POLLIN, 0};
  if (::poll(&event, 1, static_cast<int>(wait.count())) <= 0) return std::nullopt;
  return read_message();
}

void UsbIpPort::answer_oldest(std::span<const std::uint8_t> data) {
  answer(waiting_.front(), data, 0);
  waiting_.pop_front();
}

void UsbIpPort::answer(const UsbRequest& request, std::span<const std::uint8_t> data, int status) {
  const auto sent =
      request.is_in ? data.first(std::min(data.size(), request.length)) : data.first(0);
  Words words{};
  words[kCommand] = htonl(kSubmitted);
  words[kNumber] = htonl(request.number);
  words[kFifth] = htonl(static_cast<std::uint32_t>(status));
  words[kSixth] =
      htonl(static_cast<std::uint32_t>(request.is_in ? sent.size() : request.data.size()));
  Bytes message(bytes_of(words).begin(), bytes_of(words).end());
  message.insert(message.end(), sent.begin(), sent.end());
  write(message);
}

std::optional<UsbRequest> UsbIpPort::read_message() {
  Words words{};
  read(words.data(), sizeof(words));
  for (std::size_t i = 0; i < 10; ++i) words[i] = ntohl(words[i]);  // the rest is setup bytes
  if (words[kCommand] == kUnlink) {
    withdraw(words[kNumber], words[kFifth]);
    return std::nullopt;
  }
  if (words[kCommand] != kSubmit) throw std::runtime_error("the kernel does not speak USB/IP");
  UsbRequest request;
  request.number = words[kNumber];
  request.endpoint = words[kEndpoint];
  request.is_in = words[kDirection] == 1;
  request.length = words[kSixth];
  std::memcpy(request.setup.data(), &words[10], request.setup.size());
  if (!request.is_in) {
    request.data.resize(request.length);
    read(request.data.data(), request.length);
  }
  if (request.endpoint == 0) return request;
  waiting_.push_back(std::move(request));
  return std::nullopt;
}

/// The kernel takes a transfer back; `status` tells it whether it came in time.
void UsbIpPort::withdraw(std::uint32_t message, std::uint32_t request) {
  const auto count = std::erase_if(
      waiting_, [request](const UsbRequest& waiting) { return waiting.number == request; });
  Words words{};
  words[kCommand] = htonl(kUnlinked);
  words[kNumber] = htonl(message);
  words[kFifth] = htonl(count == 0 ? 0 : static_cast<std::uint32_t>(-ECONNRESET));
  write(bytes_of(words));
}

void UsbIpPort::read(void* into, std::size_t bytes) const {
  const auto count = bytes == 0 ? 0 : ::recv(line_.get(), into, bytes, MSG_WAITALL);
  if (count != static_cast<ssize_t>(bytes)) throw std::runtime_error("unplugged by the kernel");
}

void UsbIpPort::write(std::span<const std::uint8_t> bytes) const {
  while (!bytes.empty()) {
    const auto count = ::send(line_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (count <= 0) throw std::runtime_error("unplugged by the kernel");
    bytes = bytes.subspan(static_cast<std::size_t>(count));
  }
}

}  // namespace orbbuf::vm

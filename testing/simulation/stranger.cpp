// SPDX-License-Identifier: Apache-2.0
// A program of a simulated machine that is neither a robot nor a server, and knows the protocol:
//   answer WHAT            it listens where the server did, and answers each hello with WHAT
//   visit WHAT ROBOT SESSION OF IMAGE [NUMBER ...]
//                          it says hello as that robot in that session, and sends IMAGE as frames
//                          of those numbers, live ones, or late ones of the session OF
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/crc32.hpp"
#include "common/wire.hpp"

namespace orbbuf::simulation {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::uint16_t kPort = 7722;
constexpr int kPatienceMs = 3000;

sockaddr_in server_address() {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(kPort);
  address.sin_addr.s_addr = htonl(0x0A000001U);  // 10.0.0.1
  return address;
}

bool send_all(int socket, std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(sent));
  }
  return true;
}

/// Reads and forgets what comes, until nothing does, or so many bytes have come.
void read_some(int socket, std::size_t most) {
  std::array<std::uint8_t, 4096> bytes{};
  for (std::size_t got = 0; got < most;) {
    pollfd one{socket, POLLIN, 0};
    if (::poll(&one, 1, kPatienceMs) <= 0) return;
    const ssize_t more = ::recv(socket, bytes.data(), std::min(bytes.size(), most - got), 0);
    if (more <= 0) return;
    got += static_cast<std::size_t>(more);
  }
}

Bytes answer_of(std::string_view what) {
  using wire::ErrorCode;
  if (what == "sent away") return encode(wire::ErrorMessage{ErrorCode::kSentAway, "full"});
  if (what == "refused") return encode(wire::ErrorMessage{ErrorCode::kRefused, "not now"});
  if (what == "bye") return encode(wire::Bye{});
  if (what == "beyond") {  // a position that no robot has reached
    wire::Welcome welcome;
    welcome.position = {std::numeric_limits<Sequence>::max() / 2, 1U << 30U};
    welcome.takes.set(wire::kFrames).set(wire::kDrops);
    return encode(welcome);
  }
  if (what == "garbage") return Bytes(100, 0x5A);
  return {};  // silence
}

int answer(std::string_view what) {
  const int listener = ::socket(AF_INET, SOCK_STREAM, 0);
  const sockaddr_in address = server_address();
  if (::bind(listener, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) return 1;
  if (::listen(listener, SOMAXCONN) != 0) return 1;
  const Bytes bytes = answer_of(what);
  for (;;) {
    const int socket = ::accept(listener, nullptr, nullptr);
    if (socket < 0) return 1;
    read_some(socket, wire::kHeaderBytes);
    send_all(socket, bytes);
    ::shutdown(socket, SHUT_WR);
    read_some(socket, wire::kMaxControlBytes);
    ::close(socket);
  }
}

EncodedFrame frame_of(Sequence number, const Bytes& image) {
  EncodedFrame frame;
  frame.sequence = number;
  frame.capture_time_ns = static_cast<std::int64_t>(number);
  frame.width_px = frame.height_px = 1;
  frame.jpeg = image;
  frame.jpeg_crc = crc32(image);
  return frame;
}

struct Visit {
  std::string what;
  std::string robot;
  std::string session;
  std::string of;
  Bytes image;
  std::vector<Sequence> numbers;
};

bool send_frames(int socket, const Visit& visit) {
  std::uint64_t late = 0;
  for (const Sequence number : visit.numbers) {
    const EncodedFrame frame = frame_of(number, visit.image);
    if (visit.what == "live") {
      if (!send_all(socket, wire::encode_frame_head(frame))) return false;
      if (!send_all(socket, frame.jpeg)) return false;
    } else {
      const Bytes record = wire::encode_late_record(visit.of, frame);
      const wire::LatePart part{0, static_cast<std::uint32_t>(record.size()), record};
      const Bytes message = encode(wire::Items{wire::kLate, late++, wire::encode_late_part(part)});
      if (!send_all(socket, message)) return false;
    }
  }
  return true;
}

int visit(const Visit& visit) {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  const sockaddr_in address = server_address();
  if (::connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) return 0;
  wire::Hello hello;
  hello.robot_id = visit.robot;
  hello.session_id = visit.session;
  hello.software = "a stranger";
  Bytes bytes = encode(hello);
  if (visit.what == "half") bytes.resize(bytes.size() / 2);
  if (visit.what == "garbage") std::fill(bytes.begin(), bytes.end(), std::uint8_t{0x5A});
  if (!send_all(socket, bytes)) return 0;
  const bool is_welcome = visit.what == "live" || visit.what == "late";
  if (is_welcome) read_some(socket, wire::kHeaderBytes);
  if (is_welcome && !send_frames(socket, visit)) return 0;
  read_some(socket, std::numeric_limits<std::size_t>::max());
  ::close(socket);
  return 0;
}

Bytes read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace
}  // namespace orbbuf::simulation

int main(int argc, char** argv) {
  using namespace orbbuf::simulation;  // NOLINT: of this file
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (words.size() == 2 && words[0] == "answer") return answer(words[1]);
  constexpr std::size_t kNumbers = 6;
  if (words.size() < kNumbers || words[0] != "visit") return EXIT_FAILURE;
  Visit whose{words[1], words[2], words[3], words[4], read_file(words[5]), {}};
  for (std::size_t i = kNumbers; i < words.size(); ++i) {
    whose.numbers.push_back(std::stoull(words[i]));
  }
  return visit(whose);
}

// SPDX-License-Identifier: Apache-2.0
// The naive way to send a folder of orbbuf-world, and what counts the frames of any rival:
//   send WORLD ADDRESS PORT        each JPEG when it is due, over one plain, blocking TCP
//   connection;
//                                  those that fall due while it blocks are lost
//   film WORLD                     the same frames as multipart on the standard output, for
//   GStreamer,
//                                  the reader of which never blocks it for long
//   receive WORLD ADDRESS PORT     JPEG after JPEG from one connection, known by their bytes
// For each frame `receive` prints a line, ID TIME, in seconds of the system's clock.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;

struct Frame {
  double time_s = 0;
  std::string jpeg;
};

/// `result` of a system call, or an exception that says what was tried.
ssize_t check(ssize_t result, const std::string& attempt) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), attempt);
  return result;
}

std::vector<Frame> read_world(const std::filesystem::path& folder) {
  std::ifstream times(folder / "times.txt");
  std::vector<Frame> frames;
  std::string id;
  double exposure_ms = 0;
  for (double time_s = 0; times >> id >> time_s >> exposure_ms;) {
    std::ifstream image(folder / "images" / (id + ".jpg"), std::ios::binary);
    frames.push_back({time_s, std::string(std::istreambuf_iterator<char>(image), {})});
  }
  if (frames.empty()) throw std::runtime_error("no frames in " + folder.string());
  return frames;
}

sockaddr_in endpoint(const std::string& address, const std::string& port) {
  sockaddr_in result{};
  result.sin_family = AF_INET;
  result.sin_port = htons(static_cast<std::uint16_t>(std::stoul(port)));
  if (::inet_pton(AF_INET, address.c_str(), &result.sin_addr) != 1) {
    throw std::runtime_error("not an IPv4 address: " + address);
  }
  return result;
}

int make_socket() { return static_cast<int>(check(::socket(AF_INET, SOCK_STREAM, 0), "socket")); }

/// Calls write(frame) for each when it is due, but for those that fell due during an earlier call.
template <class Write>
void film(const std::vector<Frame>& frames, const Write& write) {
  const auto begin = Clock::now();
  const auto due = [&](std::size_t i) {
    return begin + std::chrono::duration_cast<Clock::duration>(
                       std::chrono::duration<double>(frames[i].time_s - frames[0].time_s));
  };
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (i + 1 < frames.size() && Clock::now() > due(i + 1)) continue;
    std::this_thread::sleep_until(due(i));
    write(frames[i]);
  }
}

void send(const std::vector<Frame>& frames, const sockaddr_in& server) {
  const int socket = make_socket();
  check(::connect(socket, reinterpret_cast<const sockaddr*>(&server), sizeof server), "connect");
  film(frames, [socket](const Frame& frame) {
    const std::string& jpeg = frame.jpeg;
    for (std::size_t sent = 0; sent < jpeg.size();) {
      sent += static_cast<std::size_t>(
          check(::send(socket, jpeg.data() + sent, jpeg.size() - sent, MSG_NOSIGNAL), "send"));
    }
  });
  check(::close(socket), "close");
}

void print_parts(const std::vector<Frame>& frames) {
  film(frames, [](const Frame& frame) {
    std::printf("--part\r\nContent-Type: image/jpeg\r\nContent-Length: %zu\r\n\r\n",
                frame.jpeg.size());
    std::fwrite(frame.jpeg.data(), 1, frame.jpeg.size(), stdout);
    std::fputs("\r\n", stdout);
    std::fflush(stdout);
  });
}

void print_frame(std::size_t id) {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  std::printf("%06zu %.6f\n", id, std::chrono::duration<double>(now).count());
  std::fflush(stdout);
}

void receive(const std::vector<Frame>& frames, const sockaddr_in& self) {
  std::map<std::string, std::size_t> ids;
  for (std::size_t i = 0; i < frames.size(); ++i) ids.emplace(frames[i].jpeg, i);
  const int listener = make_socket();
  check(::bind(listener, reinterpret_cast<const sockaddr*>(&self), sizeof self), "bind");
  check(::listen(listener, 1), "listen");
  std::fputs("listening\n", stderr);
  const auto socket = static_cast<int>(check(::accept(listener, nullptr, nullptr), "accept"));
  const std::string end_of_image = "\xff\xd9";
  std::string pending;
  std::array<char, 65536> chunk{};
  while (const ssize_t count = check(::recv(socket, chunk.data(), chunk.size(), 0), "receive")) {
    const std::size_t looked = pending.empty() ? 0 : pending.size() - 1;
    pending.append(chunk.data(), static_cast<std::size_t>(count));
    for (auto end = pending.find(end_of_image, looked); end != std::string::npos;
         end = pending.find(end_of_image)) {
      const auto known = ids.find(pending.substr(0, end + end_of_image.size()));
      if (known == ids.end()) throw std::runtime_error("received what is not a frame");
      print_frame(known->second);
      pending.erase(0, end + end_of_image.size());
    }
  }
}

int run(const std::vector<std::string>& words) {
  if (words.size() == 4 && words[0] == "send") {
    send(read_world(words[1]), endpoint(words[2], words[3]));
  } else if (words.size() == 2 && words[0] == "film") {
    print_parts(read_world(words[1]));
  } else if (words.size() == 4 && words[0] == "receive") {
    receive(read_world(words[1]), endpoint(words[2], words[3]));
  } else {
    std::fputs("usage: orbbuf-paper-peer send|receive WORLD ADDRESS PORT | film WORLD\n", stderr);
    return 2;
  }
  return EXIT_SUCCESS;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run({argv + 1, argv + argc});
  } catch (const std::exception& error) {
    std::fprintf(stderr, "orbbuf-paper-peer: %s\n", error.what());
    return EXIT_FAILURE;
  }
}

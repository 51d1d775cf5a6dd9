// SPDX-License-Identifier: Apache-2.0
// What the bench of the link measures with, and against:
//   send ADDRESS PORT BYTES FPS   a camera over one plain, blocking TCP connection
//   receive ADDRESS PORT          its other end: a line for each whole frame, TIME BYTES
//                                 send and receive: a last word, mptcp, for Multipath TCP
//   read FPS                      a SLAM program that takes at most FPS frames a second from its
//                                 standard input: a line for each, TIME BYTES NUMBER
//   watch FOLDER                  the same line, and the file's name, for each file that is renamed
//                                 into FOLDER
//   path NEAR FAR SECONDS [TRACE | REORDER REPEAT FLIP]
//                                 two network interfaces, and the packets between them, each of
//                                 which takes that long; from NEAR to FAR only at the times of a
//                                 trace of mahimahi's, after a queue of 500 kB; or with these
//                                 shares of PacketFaults
// TIME is in seconds of the system's clock. Each runs until it is killed.
#include <arpa/inet.h>
#include <sys/inotify.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "bench/link/long_path.hpp"
#include "bench/plain_socket.hpp"
#include "bench/run_program.hpp"
#include "orbbuf/pipe.h"

namespace {

using orbbuf::bench::check;

using Clock = std::chrono::steady_clock;

constexpr int kMultipath = 262;  // IPPROTO_MPTCP, of <linux/in.h>, which excludes <netinet/in.h>

void print_frame(std::size_t bytes, const char* name = "") {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const auto microseconds = std::chrono::duration_cast<std::chrono::microseconds>(now).count();
  constexpr long long kPerSecond = 1'000'000;
  const auto count = static_cast<long long>(microseconds);
  std::printf("%lld.%06lld %zu %s\n", count / kPerSecond, count % kPerSecond, bytes, name);
  std::fflush(stdout);
}

/// A frame is its length, 4 bytes, and that many bytes. What the camera has captured while send()
/// blocked is lost: nothing is queued but by the kernel.
void send(const std::string& address, const std::string& port, std::size_t bytes, double fps,
          int protocol) {
  const int socket = orbbuf::bench::connect_to(address, port, protocol);
  std::vector<std::uint8_t> frame(sizeof(std::uint32_t) + bytes, 'x');
  const std::uint32_t length = htonl(static_cast<std::uint32_t>(bytes));
  std::memcpy(frame.data(), &length, sizeof length);
  const auto interval =
      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / fps));
  for (auto due = Clock::now();; due += interval) {
    while (due + interval < Clock::now()) due += interval;
    std::this_thread::sleep_until(due);
    orbbuf::bench::send_all(socket, frame.data(), frame.size());
  }
}

/// False at the end of the stream.
bool receive_all(int socket, std::uint8_t* to, std::size_t size) {
  return static_cast<std::size_t>(check(::recv(socket, to, size, MSG_WAITALL), "receive")) == size;
}

void receive(const std::string& address, const std::string& port, int protocol) {
  const int socket = orbbuf::bench::accept_one(address, port, protocol);
  std::vector<std::uint8_t> frame;
  for (std::array<std::uint8_t, sizeof(std::uint32_t)> head{};
       receive_all(socket, head.data(), head.size());) {
    std::uint32_t length = 0;
    std::memcpy(&length, head.data(), sizeof length);
    frame.resize(ntohl(length));
    if (!receive_all(socket, frame.data(), frame.size())) return;
    print_frame(frame.size());
  }
}

/// Like a SLAM program it reads a frame as a whole and then leaves the pipe alone.
void read(double fps) {
  orbbuf_reader reader;
  orbbuf_image image;
  orbbuf_reader_init(&reader, stdin);
  const auto interval =
      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / fps));
  auto due = Clock::now();
  while (orbbuf_read(&reader, &image) == 1) {
    print_frame(image.size, std::to_string(image.seq).c_str());
    due = std::max(due, Clock::now() - interval) + interval;
    std::this_thread::sleep_until(due);
  }
  orbbuf_reader_free(&reader);
}

void print_file(const std::string& folder, const char* name) {
  struct stat status {};
  if (::stat((folder + "/" + name).c_str(), &status) != 0) return;
  print_frame(static_cast<std::size_t>(status.st_size), name);
}

void watch(const std::string& folder) {
  const auto notify = static_cast<int>(check(::inotify_init1(IN_CLOEXEC), "inotify_init1"));
  check(::inotify_add_watch(notify, folder.c_str(), IN_MOVED_TO), "watch " + folder);
  std::fprintf(stderr, "watching %s\n", folder.c_str());
  constexpr std::size_t kRoom = 65536;
  for (alignas(inotify_event) std::array<char, kRoom> events{};;) {
    const auto count = check(::read(notify, events.data(), events.size()), "read events");
    for (ssize_t at = 0; at < count;) {
      const auto* event = reinterpret_cast<const inotify_event*>(events.data() + at);
      print_file(folder, event->name);
      at += static_cast<ssize_t>(sizeof(inotify_event) + event->len);
    }
  }
}

int run(std::vector<std::string> words) {
  const bool is_multipath = !words.empty() && words.back() == "mptcp";
  if (is_multipath) words.pop_back();
  const int protocol = is_multipath ? kMultipath : 0;
  if (words.size() == 5 && words[0] == "send") {
    send(words[1], words[2], std::stoul(words[3]), std::stod(words[4]), protocol);
  } else if (words.size() == 3 && words[0] == "receive") {
    receive(words[1], words[2], protocol);
  } else if (words.size() == 2 && words[0] == "read") {
    read(std::stod(words[1]));
  } else if (words.size() == 2 && words[0] == "watch") {
    watch(words[1]);
  } else if ((words.size() == 4 || words.size() == 5 || words.size() == 7) && words[0] == "path") {
    orbbuf::bench::PacketFaults faults;
    if (words.size() == 7) {
      faults = {std::stod(words[4]), std::stod(words[5]), std::stod(words[6])};
    }
    orbbuf::bench::carry_packets(words[1], words[2],
                                 std::chrono::duration_cast<std::chrono::nanoseconds>(
                                     std::chrono::duration<double>(std::stod(words[3]))),
                                 words.size() == 5 ? words[4] : "", faults);
  } else {
    std::fputs(
        "usage: orbbuf-link-peer send ADDRESS PORT BYTES FPS [mptcp] | receive ADDRESS PORT "
        "[mptcp] | "
        "read FPS | watch FOLDER | path NEAR FAR SECONDS [TRACE | REORDER REPEAT FLIP]\n",
        stderr);
    return 2;
  }
  return EXIT_SUCCESS;
}

}  // namespace

int main(int argc, char** argv) {
  return orbbuf::bench::run_program("orbbuf-link-peer", [&] {
    return run({argv + 1, argv + argc});
  });
}

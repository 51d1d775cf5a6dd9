// SPDX-License-Identifier: Apache-2.0
// The naive way to send a folder of orbbuf-world, and what counts the frames of any baseline:
//   send WORLD ADDRESS PORT      each JPEG when it is due, over one plain, blocking connection;
//                                those that fall due while it blocks are lost
//   play WORLD                   the same frames as multipart on the standard output, for
//                                GStreamer, which never blocks it for long
//   play-gray WORLD              decoded, for GStreamer to encode: gray pixels, image after image
//   decode WORLD                 the same, all at once
//   receive WORLD ADDRESS PORT   JPEG after JPEG from one connection, known by their bytes
// For each frame `receive` prints a line, ID TIME, in seconds of the system's clock.
#include <sys/socket.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "bench/plain_socket.hpp"
#include "bench/run_program.hpp"
#include "common/as_bytes.hpp"
#include "common/jpeg.hpp"

namespace {

using Clock = std::chrono::steady_clock;

struct Frame {
  double time_s = 0;
  std::string jpeg;
};

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

/// Calls write(frame) for each when it is due, but for those that fell due during an earlier call.
template <class Write>
void play(const std::vector<Frame>& frames, const Write& write) {
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

void send(const std::vector<Frame>& frames, int socket) {
  play(frames, [socket](const Frame& frame) {
    orbbuf::bench::send_all(socket, frame.jpeg.data(), frame.jpeg.size());
  });
}

void print_parts(const std::vector<Frame>& frames) {
  play(frames, [](const Frame& frame) {
    std::printf("--part\r\nContent-Type: image/jpeg\r\nContent-Length: %zu\r\n\r\n",
                frame.jpeg.size());
    std::fwrite(frame.jpeg.data(), 1, frame.jpeg.size(), stdout);
    std::fputs("\r\n", stdout);
    std::fflush(stdout);
  });
}

void print_gray(const Frame& frame) {
  static orbbuf::JpegCodec codec;
  const auto image = codec.decode_gray(orbbuf::as_bytes(frame.jpeg), 1);
  if (!image) throw std::runtime_error(image.error().text);
  std::fwrite(image.value().pixels.data(), 1, image.value().pixels.size(), stdout);
  std::fflush(stdout);
}

void print_frame(std::size_t id) {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  std::printf("%06zu %.6f\n", id, std::chrono::duration<double>(now).count());
  std::fflush(stdout);
}

void receive(const std::vector<Frame>& frames, const std::string& address,
             const std::string& port) {
  std::map<std::string, std::size_t> ids;
  for (std::size_t i = 0; i < frames.size(); ++i) ids.emplace(frames[i].jpeg, i);
  const int socket = orbbuf::bench::accept_one(address, port);
  const std::string end_of_image = "\xff\xd9";
  std::string pending;
  std::array<char, 65536> chunk{};
  while (const ssize_t count =
             orbbuf::bench::check(::recv(socket, chunk.data(), chunk.size(), 0), "receive")) {
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
    send(read_world(words[1]), orbbuf::bench::connect_to(words[2], words[3]));
  } else if (words.size() == 2 && words[0] == "play") {
    print_parts(read_world(words[1]));
  } else if (words.size() == 2 && words[0] == "play-gray") {
    play(read_world(words[1]), print_gray);
  } else if (words.size() == 2 && words[0] == "decode") {
    for (const Frame& frame : read_world(words[1])) print_gray(frame);
  } else if (words.size() == 4 && words[0] == "receive") {
    receive(read_world(words[1]), words[2], words[3]);
  } else {
    std::fputs(
        "usage: orbbuf-evaluation-peer send|receive WORLD ADDRESS PORT | play|play-gray|decode "
        "WORLD\n",
        stderr);
    return 2;
  }
  return EXIT_SUCCESS;
}

}  // namespace

int main(int argc, char** argv) {
  return orbbuf::bench::run_program("orbbuf-evaluation-peer", [&] {
    return run({argv + 1, argv + argc});
  });
}

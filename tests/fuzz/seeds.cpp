// SPDX-License-Identifier: Apache-2.0
// Writes the fuzzers' first inputs, from the samples that the tests use: a folder for each fuzzer.
#include <filesystem>
#include <iostream>

#include "common/jpeg.hpp"
#include "daemon/record/record_format.hpp"
#include "server/session/records.hpp"
#include "testing/source_folder.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/common/wire_samples.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using wire::Bytes;

Bytes joined(const std::vector<Bytes>& messages) {
  Bytes all;
  for (const Bytes& message : messages) all.insert(all.end(), message.begin(), message.end());
  return all;
}

/// And stereo.
EncodedFrame reduced_frame(Sequence sequence) {
  EncodedFrame frame = test::plain_frame(sequence);
  frame.left_bytes = 60;
  frame.quality = 30;
  frame.whole_bytes = 30'000;
  return frame;
}

/// A short life: hello, frames with a repeat, drop records, stats, bye.
Bytes life(const std::string& session) {
  return joined({wire::encode(wire::Hello{6, 6, "r", session, "orbbufd", "", {}}),
                 wire::encode_whole(test::plain_frame(0)), wire::encode_whole(reduced_frame(2)),
                 wire::encode_whole(test::plain_frame(0)),
                 wire::encode(*test::drops_ptr(0, {{1, 0, DropReason::kPolicy}})),
                 wire::encode(wire::Report{{3, 0, 0, 1, 2, 0, 0}}),
                 wire::encode(wire::Bye{{3, 1}})});
}

void write(const fs::path& file, const Bytes& bytes) {
  fs::create_directories(file.parent_path());
  test::write_file(file, test::as_text(bytes));
}

void write_seeds(const fs::path& folder) {
  for (const auto& [name, bytes] : wire::sample_messages()) write(folder / "wire" / name, bytes);
  write(folder / "wire/late record", wire::encode_late_record("s", wire::sample_frame()));
  // Bytes at a time, and where the first connection ends: session_fuzz.cpp.
  write(folder / "session/one", joined({{255, 255}, life("s")}));
  write(folder / "session/replaced", joined({{255, 128}, life("s"), life("s")}));
  write(folder / "session/rebooted", joined({{3, 100}, life("s"), life("t")}));
  int request = 0;  // the first byte: how many come at a time
  for (const char* path : {"/", "/robots/r/image", "/metrics", "/api/robots?since=7", "/healthz",
                           "/api/sessions/r/s", "/sessions/r/s/images/000001.jpg"}) {
    write(folder / "http" / std::to_string(++request),
          wire::bytes_of(std::string("\x40GET ") + path +
                         " HTTP/1.1\r\nHost: localhost:7723\r\nConnection: keep-alive\r\n\r\n"
                         "HEAD / HTTP/1.0\r\nHost: [::1]\r\n\r\n"));
  }
  const std::uint8_t pixels[16 * 16 * 3] = {};
  const Bytes jpeg = JpegCodec().encode({pixels, 16, 16, 48, 3}, 80, true).value();
  const auto size = static_cast<std::uint8_t>(jpeg.size() % 256);
  const auto size_high = static_cast<std::uint8_t>(jpeg.size() / 256);
  write(folder / "jpeg/two", joined({{size_high, size}, jpeg, {size_high, size}, jpeg}));
  // The first byte: the type (journal_fuzz.cpp).
  const std::vector<DropRecord> drops(1);
  write(folder / "journal/drops",
        joined({{2}, encode(RecordedItems{wire::kDrops, 0, 1, wire::encode_drops(drops)}, {})}));
  SessionSummary summary;
  summary.info.robot_id = "r";
  summary.info.session_id = "s";
  write(folder / "journal/checkpoint", joined({{0}, encode(summary, {})}));
  write(folder / "journal/released",
        joined({{128}, record_format::encode_released("r/s", {1, 2})}));
  write(folder / "json/owner",
        wire::bytes_of(R"({"server":"a","instance":"i","epoch":2,"ended":false,)"
                       R"("segments":[{"server":"a","epoch":1,"next":[0]}]})"));
  write(folder / "json/subscribe",
        wire::bytes_of(R"({"op":"subscribe","subscriptions":[{"id":0,"channelId":3}]})"));
  const fs::path samples = test::kSourceFolder + std::string("/config");
  for (const char* name : {"orbbuf-server.toml", "orbbufd.toml"}) {
    write(folder / "config" / name, wire::bytes_of(test::read_file(samples / name)));
  }
}

}  // namespace
}  // namespace orbbuf

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: orbbuf-fuzz-seeds FOLDER\n";
    return 2;
  }
  orbbuf::write_seeds(argv[1]);
  return 0;
}

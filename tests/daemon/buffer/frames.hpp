// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "common/frame.hpp"
#include "daemon/buffer/drop_policy.hpp"
#include "daemon/buffer/features.hpp"
#include "daemon/buffer/frame_buffer.hpp"

/// What the tests of this folder share.
namespace orbbuf {

/// A frame every 10 ms.
inline EncodedFrame make_frame(Sequence sequence) {
  EncodedFrame frame;
  frame.sequence = sequence;
  frame.capture_time_ns = static_cast<std::int64_t>(sequence) * 10'000'000;
  frame.jpeg = {0xff};
  return frame;
}

inline FramePtr make_frame_ptr(Sequence sequence) {
  return std::make_shared<const EncodedFrame>(make_frame(sequence));
}

inline void capture_and_push(FrameBuffer& buffer, Sequence sequence) {
  buffer.on_captured();
  buffer.push(make_frame_ptr(sequence));
}

inline std::vector<DropRecord> collect_drops(FrameBuffer& buffer) {
  std::vector<DropRecord> drops;
  buffer.collect_drops(drops);
  return drops;
}

inline std::vector<Sequence> sequences_of(const std::vector<FramePtr>& frames) {
  std::vector<Sequence> sequences;
  sequences.reserve(frames.size());
  for (const FramePtr& frame : frames) sequences.push_back(frame->sequence);
  return sequences;
}

inline std::vector<Sequence> sequences_of(const std::vector<DropRecord>& records) {
  std::vector<Sequence> sequences;
  sequences.reserve(records.size());
  for (const DropRecord& record : records) sequences.push_back(record.sequence);
  return sequences;
}

/// A handful of descriptors that only this frame has.
inline void random_features(const EncodedFrame& frame, FeatureSet& features) {
  std::mt19937_64 random(frame.sequence);
  features.clear();
  for (int i = 0; i < 4; ++i) features.add({random(), random(), random(), random()}, {});
}

/// Does what the test says.
struct FakePolicy final : DropPolicy {
  std::function<bool(const BufferView&)> on_prepare = [](const BufferView&) { return false; };
  std::function<std::size_t(const BufferView&)> on_victim = [](const BufferView&) { return 0; };

  bool prepare(const BufferView& view) override { return on_prepare(view); }
  std::size_t victim(const BufferView& view) override { return on_victim(view); }
};

/// A test's name may not contain the '-' of a policy's.
inline std::string test_name(std::string name) {
  for (char& letter : name) letter = letter == '-' ? '_' : letter;
  return name;
}

}  // namespace orbbuf

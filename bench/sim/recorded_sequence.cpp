// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/recorded_sequence.hpp"

#include <algorithm>
#include <memory>
#include <stdexcept>

#include "common/jpeg.hpp"
#include "daemon/buffer/similarity.hpp"
#include "daemon/image/jpeg_encoder.hpp"
#include "daemon/image/orb_extractor.hpp"

namespace orbbuf::sim {

RecordedSequence::RecordedSequence(std::string name, SourceSettings settings)
    : name_(std::move(name)) {
  settings.realtime = false;
  const auto source = make_source(settings);
  JpegEncoder encoder(JpegSettings{});
  OrbExtractor extractor(FeatureSettings{});
  std::int64_t begin_ns = 0;
  while (const auto raw = source->next({})) {
    auto encoded = encoder.encode(*raw, frames_.size());
    if (!encoded) throw std::runtime_error(name_ + ": " + encoded.error().text);
    if (frames_.empty()) begin_ns = encoded.value().capture_time_ns;
    encoded.value().capture_time_ns -= begin_ns;
    frames_.push_back(std::make_shared<const EncodedFrame>(std::move(encoded.value())));
    extractor.extract(*frames_.back(), features_.emplace_back());
  }
  similarities_.assign(frames_.size() * frames_.size(), -1);
  if (frames_.size() < 2) throw std::runtime_error(name_ + ": less than two frames");
}

double RecordedSequence::mean_interval_ns() const {
  return static_cast<double>(frames_.back()->capture_time_ns) / static_cast<double>(size() - 1);
}

double RecordedSequence::mean_jpeg_bytes() const {
  double sum = 0;
  for (const FramePtr& frame : frames_) sum += static_cast<double>(frame->jpeg.size());
  return sum / static_cast<double>(size());
}

double RecordedSequence::self_similarity() const {
  double sum = 0;
  for (const FeatureSet& set : features_) sum += orbbuf::similarity(set, set);
  return sum / static_cast<double>(size());
}

int RecordedSequence::similarity(std::size_t i, std::size_t j) {
  int& known = similarities_[std::min(i, j) * size() + std::max(i, j)];
  if (known < 0) known = orbbuf::similarity(features_[i], features_[j]);
  return known;
}

int RecordedSequence::epipolar_inliers(std::size_t i, std::size_t j) {
  const auto [entry, is_new] = inliers_.try_emplace(std::minmax(i, j), 0);
  if (is_new) entry->second = view(i).inliers(view(j));
  return entry->second;
}

const EpipolarView& RecordedSequence::view(std::size_t i) {
  const auto known = views_.find(i);
  if (known != views_.end()) return known->second;
  return views_.try_emplace(i, JpegCodec().decode_gray(frames_[i]->jpeg, 1).value()).first->second;
}

}  // namespace orbbuf::sim

// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/recorded_sequence.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <stdexcept>

#include "common/jpeg.hpp"
#include "daemon/buffer/similarity.hpp"
#include "daemon/image/jpeg_encoder.hpp"
#include "daemon/image/orb_extractor.hpp"
#include "daemon/image/requantiser.hpp"

namespace orbbuf::sim {
namespace {

/// Rising, the last one orbbufd's default.
constexpr std::array<int, 10> kQualities = {
    RecordedSequence::kLeastQuality, 15, 20, 25, 30, 40, 50, 60, 70, 80};

std::vector<double> sizes_of(const EncodedFrame& frame, Requantiser& requantiser) {
  std::vector<double> sizes;
  for (const int quality : kQualities) {
    const auto reduced = quality < frame.quality ? requantiser.reduce(frame, quality) : Error{};
    sizes.push_back(static_cast<double>((reduced ? reduced.value() : frame).jpeg.size()));
  }
  return sizes;
}

}  // namespace

RecordedSequence::RecordedSequence(std::string name, SourceSettings settings)
    : name_(std::move(name)) {
  settings.realtime = false;
  const auto source = make_source(settings);
  JpegEncoder encoder(JpegSettings{});
  OrbExtractor extractor(FeatureSettings{});
  Requantiser requantiser;
  std::int64_t begin_ns = 0;
  while (const auto raw = source->next({})) {
    auto encoded = encoder.encode(*raw, frames_.size());
    if (!encoded) throw std::runtime_error(name_ + ": " + encoded.error().text);
    if (frames_.empty()) begin_ns = encoded.value().capture_time_ns;
    encoded.value().capture_time_ns -= begin_ns;
    encoded.value().quality = kQualities.back();  // a JPEG of the source's own counts as such
    frames_.push_back(std::make_shared<const EncodedFrame>(std::move(encoded.value())));
    extractor.extract(*frames_.back(), features_.emplace_back());
    sizes_.push_back(sizes_of(*frames_.back(), requantiser));
  }
  similarities_.assign(frames_.size() * frames_.size(), -1);
  if (frames_.size() < 2) throw std::runtime_error(name_ + ": less than two frames");
}

std::size_t RecordedSequence::bytes_at(std::size_t i, int quality) const {
  const auto above = std::ranges::lower_bound(kQualities, quality);
  const auto k = static_cast<std::size_t>(above - kQualities.begin());
  if (above == kQualities.end()) return frames_[i]->jpeg.size();
  const double share = *above == quality ? 1
                                         : static_cast<double>(quality - *(above - 1)) /
                                               static_cast<double>(*above - *(above - 1));
  const double below = k == 0 ? sizes_[i][0] : sizes_[i][k - 1];
  return static_cast<std::size_t>(std::lround(below + share * (sizes_[i][k] - below)));
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

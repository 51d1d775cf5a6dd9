// SPDX-License-Identifier: Apache-2.0
#include "daemon/image/orb_extractor.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <numeric>
#include <random>

#include "daemon/buffer/similarity.hpp"
#include "daemon/capture/make_source.hpp"
#include "daemon/image/jpeg_encoder.hpp"
#include "testing/source_folder.hpp"

namespace orbbuf {
namespace {

using testing::AllOf;
using testing::Each;
using testing::Ge;
using testing::IsEmpty;
using testing::Lt;

EncodedFrame flat_frame(int width_px, int height_px) {
  const std::vector<std::uint8_t> pixels(static_cast<std::size_t>(width_px * height_px), 90);
  EncodedFrame frame;
  frame.jpeg = JpegCodec()
                   .encode({pixels.data(), width_px, height_px, static_cast<std::size_t>(width_px)},
                           80, false)
                   .value();
  return frame;
}

/// The descriptors that replace one of another frame.
std::vector<Descriptor> extract(OrbExtractor& extractor, const EncodedFrame& frame) {
  FeatureSet features{{Descriptor{1, 2, 3, 4}}};
  extractor.extract(frame, features);
  return features.descriptors;
}

/// The features of a source's first frames, by way of their JPEG.
std::vector<FeatureSet> features_of(SourceSettings source_settings, std::size_t count,
                                    const FeatureSettings& settings = {}) {
  source_settings.realtime = false;
  const auto source = make_source(source_settings);
  JpegEncoder encoder({});
  OrbExtractor extractor(settings);
  std::vector<FeatureSet> features;
  while (features.size() < count) {
    const auto raw = source->next({});
    if (!raw) break;
    const EncodedFrame frame = encoder.encode(*raw, features.size()).value();
    extractor.extract(frame, features.emplace_back());
  }
  return features;
}

/// M of all pairs that many frames apart.
std::vector<int> similarities(const std::vector<FeatureSet>& features, std::size_t apart) {
  std::vector<int> result;
  for (std::size_t i = 0; i + apart < features.size(); ++i) {
    result.push_back(similarity(features[i], features[i + apart]));
  }
  return result;
}

int mean(const std::vector<int>& values) {
  return std::accumulate(values.begin(), values.end(), 0) / static_cast<int>(values.size());
}

TEST(OrbExtractor, FindsAboutAsManyFeaturesAsAskedForAndTheSameEveryTime) {
  SourceSettings scene;
  const auto features = features_of(scene, 2, {.count = 300});
  ASSERT_EQ(features.size(), 2U);
  EXPECT_GE(features[0].descriptors.size(), 250U);
  EXPECT_LE(features[0].descriptors.size(), 330U);
  const FeatureSet again = features_of(scene, 1, {.count = 300})[0];
  EXPECT_EQ(features[0].descriptors, again.descriptors);
  EXPECT_EQ(features[0].positions, again.positions);
}

TEST(OrbExtractor, PositionsAreSharesOfTheWidthWhateverTheScale) {
  for (const int pixels : {640 * 480, 320 * 240}) {
    const FeatureSet features = features_of({}, 1, {.pixels = pixels})[0];
    for (const ImagePoint& position : features.positions) {
      EXPECT_THAT(position.x, AllOf(Ge(31), Lt(ImagePoint::kWidth - 31)));
      EXPECT_THAT(position.y, AllOf(Ge(31), Lt(ImagePoint::kWidth * 480 / 640 - 31)));
    }
  }
}

TEST(OrbExtractor, ReplacesWhatTheSetHeldBeforeAndKeepsItsStorage) {
  OrbExtractor extractor({});
  const EncodedFrame frame = JpegEncoder({}).encode(make_source({})->next({}).value(), 0).value();
  FeatureSet features;
  extractor.extract(frame, features);
  const FeatureSet first = features;
  const Descriptor* storage = features.descriptors.data();
  extractor.extract(frame, features);
  EXPECT_EQ(features.descriptors, first.descriptors);
  EXPECT_EQ(features.descriptors.data(), storage);
}

TEST(OrbExtractor, WorksAtEveryScaleOfTheDecoder) {
  for (const int pixels : {640 * 480, 320 * 240, 160 * 120}) {
    EXPECT_GT(features_of({}, 1, {.pixels = pixels})[0].descriptors.size(), 50U) << pixels;
  }
}

TEST(OrbExtractor, AJpegThatCannotBeDecodedHasNoFeatures) {
  OrbExtractor extractor({});
  EncodedFrame frame;
  EXPECT_THAT(extract(extractor, frame), IsEmpty());
  frame.jpeg = {0xFF, 0xD8, 0xFF, 0xD9};
  EXPECT_THAT(extract(extractor, frame), IsEmpty());
}

TEST(OrbExtractor, ABlankWallHasNoFeatures) {
  OrbExtractor extractor({});
  EXPECT_THAT(extract(extractor, flat_frame(640, 480)), IsEmpty());
}

/// The generated scene with nearly all contrast taken away, as where a wall fills the image.
std::vector<FeatureSet> pale_features(std::size_t count) {
  SourceSettings settings;
  settings.realtime = false;
  const auto source = make_source(settings);
  JpegEncoder encoder({});
  OrbExtractor extractor({});
  std::vector<FeatureSet> features;
  while (features.size() < count) {
    RawFrame raw = source->next({}).value();
    std::vector<std::uint8_t> pixels(raw.data.begin(), raw.data.end());
    for (std::uint8_t& pixel : pixels) pixel = static_cast<std::uint8_t>(110 + pixel / 6);
    raw.data = pixels;
    extractor.extract(encoder.encode(raw, features.size()).value(), features.emplace_back());
  }
  return features;
}

TEST(OrbExtractor, WhereThereIsLittleContrastNeighboursAreStillToldFromStrangers) {
  const auto features = pale_features(280);
  EXPECT_THAT(similarities(features, 1), Each(Ge(50)));
  EXPECT_LT(similarity(features[250], features[275]), 20);
}

TEST(OrbExtractor, ImagesOfAnySizeAreTakenHoweverSmall) {
  OrbExtractor extractor({});
  for (const int side : {1, 2, 8, 31, 61, 62, 63, 64, 65, 80, 100}) {
    EXPECT_THAT(extract(extractor, flat_frame(side, side)), IsEmpty()) << side;
    EXPECT_THAT(extract(extractor, flat_frame(640, side)), IsEmpty()) << side;
  }
  SourceSettings scene;
  for (const int side : {64, 67, 72, 96, 128}) {
    scene.width_px = side;
    scene.height_px = side;
    EXPECT_LE(features_of(scene, 1)[0].descriptors.size(), 600U) << side;
  }
}

TEST(OrbExtractor, InAGeneratedTurnASecondLosesEverythingAndElsewhereLittle) {
  const auto features = features_of({}, 280);
  ASSERT_EQ(features.size(), 280U);
  EXPECT_THAT(similarities(features, 1), Each(Ge(150)));
  EXPECT_GT(similarity(features[0], features[25]), 150);
  EXPECT_GT(similarity(features[175], features[200]), 150);
  EXPECT_LT(similarity(features[250], features[275]), 20);
}

/// Of every real sequence; empty, and said so, if one is absent.
std::vector<std::vector<FeatureSet>> real_features() {
  std::vector<std::vector<FeatureSet>> all;
  for (const char* name : {"picar_indoor", "kitti06_mono", "kitti05_stereo"}) {
    SourceSettings sequence;
    sequence.kind = "folder";
    sequence.path =
        std::filesystem::path(test::kSourceFolder) / ".." / "shared" / "data" / "sequences" / name;
    if (!exists(sequence.path)) return {};
    all.push_back(features_of(sequence, 60));
  }
  return all;
}

TEST(OrbExtractor, UnrelatedFramesMatchInUnderATwentiethOfTheirFeatures) {
  const auto all = real_features();
  if (all.empty()) GTEST_SKIP() << "../shared/data/sequences is absent";
  std::mt19937 random(1);
  int above = 0;
  for (int pairs = 0; pairs < 1000;) {
    const auto& one = all[random() % all.size()];
    const auto& other = all[random() % all.size()];
    if (&one == &other) continue;
    ++pairs;
    const FeatureSet& a = one[random() % one.size()];
    const FeatureSet& b = other[random() % other.size()];
    if (20 * similarity(a, b) >= std::min(similarity(a, a), similarity(b, b))) ++above;
  }
  EXPECT_LE(above, 10);
}

TEST(OrbExtractor, NeighboursAtVideoRateShareOverHalfOfTheirFeatures) {
  const auto features = features_of({}, 200);  // generated, 25 frames a second
  const std::vector<int> neighbours = similarities(features, 1);
  const auto few = std::ranges::count_if(
      neighbours, [&](int matches) { return 2 * matches <= similarity(features[0], features[0]); });
  EXPECT_LE(20 * static_cast<std::size_t>(few), neighbours.size());
}

TEST(OrbExtractor, NeighboursOfRealSequencesAreAlikeAndFramesFarApartAreNot) {
  for (const auto& [name, apart] :
       {std::pair("picar_indoor", 100U), {"kitti06_mono", 40U}, {"kitti05_stereo", 40U}}) {
    SourceSettings sequence;
    sequence.kind = "folder";
    sequence.path =
        std::filesystem::path(test::kSourceFolder) / ".." / "shared" / "data" / "sequences" / name;
    if (!exists(sequence.path)) GTEST_SKIP() << sequence.path << " is absent";
    const auto features = features_of(sequence, 150);
    EXPECT_GT(mean(similarities(features, 1)), 100) << name;
    EXPECT_THAT(similarities(features, apart), Each(AllOf(Ge(0), Lt(25)))) << name;
    EXPECT_LT(mean(similarities(features, apart)), 10) << name;
    EXPECT_GE(similarity(features[0], features[0]), 350) << name;
  }
}

TEST(OrbExtractor, OfAStereoFrameTheLeftImageIsJudged) {
  SourceSettings settings;
  settings.realtime = false;
  const auto source = make_source(settings);
  auto raw = *source->next({});
  JpegEncoder encoder({});
  const auto mono = encoder.encode(raw, 0).value();
  raw.right = std::make_shared<const RawFrame>(*source->next({}));
  const auto stereo = encoder.encode(raw, 0).value();
  OrbExtractor extractor({});
  const auto descriptors = extract(extractor, mono);
  EXPECT_FALSE(descriptors.empty());
  EXPECT_EQ(extract(extractor, stereo), descriptors);
}

}  // namespace
}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#include "evaluation/outages/list_maker.hpp"

#include <gtest/gtest.h>

#include <stdexcept>

namespace orbbuf::evaluation {
namespace {

TEST(PlaceOutages, AreEvenlySpacedWithinTheSequence) {
  const Places places = place_outages(60, 5, 3, 3, 4);
  EXPECT_EQ(places.begin_s, (std::vector<double>{3, 27, 51}));
  EXPECT_EQ(places.played_s, 60);
  EXPECT_EQ(place_outages(60, 5, 1, 3, 4).begin_s, std::vector<double>{3});
}

TEST(PlaceOutages, OfAShortSequenceAreThoseOfOneWay) {
  const Places places = place_outages(8, 5, 3, 3, 4);
  EXPECT_EQ(places.begin_s, (std::vector<double>{3, 7, 11}));
  EXPECT_EQ(places.played_s, 20);
}

TEST(ReadLink, HasATraceAndAMultipleOfTheNeed) {
  const Link link = read_link("constant:1.5", "");
  EXPECT_EQ(link.name, "constant-1.5");
  EXPECT_EQ(link.need, 1.5);
  EXPECT_EQ(link.trace.steps.size(), 1U);
  for (const char* wrong : {"constant", "constant:", "constant:0", "constant:1.5x"}) {
    EXPECT_ANY_THROW(read_link(wrong, "")) << wrong;
  }
  EXPECT_THROW(read_link("nothing.up:2", "/nonexistent"), std::runtime_error);
}

}  // namespace
}  // namespace orbbuf::evaluation

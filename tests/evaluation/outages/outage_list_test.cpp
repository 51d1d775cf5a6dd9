// SPDX-License-Identifier: Apache-2.0
#include "evaluation/outages/outage_list.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "testing/temporary_folder.hpp"

namespace orbbuf::evaluation {
namespace {

TEST(OutageList, ComesBackAsItWasWritten) {
  const test::TemporaryFolder folder;
  const OutageList written{"drive",
                           "ab12",
                           "catch-up",
                           "constant-1.5",
                           1,
                           1.25,
                           3.5,
                           2,
                           {{"000007.png", 7, 0.28, 0.301234, 80}, {"000008.png", 8, 0.32, 6, 20}}};
  write_list(folder / "catch-up.csv", written);
  const OutageList read = read_list(folder / "catch-up.csv");
  EXPECT_EQ(read.sequence, "drive");
  EXPECT_EQ(read.sha256, "ab12");
  EXPECT_EQ(read.policy, "catch-up");
  EXPECT_EQ(read.link, "constant-1.5");
  EXPECT_EQ(read.lateness_s, 1);
  EXPECT_EQ(read.live_again_s, 1.25);
  EXPECT_EQ(read.return_s(), 5.5);
  ASSERT_EQ(read.arrivals.size(), 2U);
  EXPECT_EQ(read.arrivals[0].image, "000007.png");
  EXPECT_EQ(read.arrivals[0].number, 7U);
  EXPECT_EQ(read.arrivals[0].capture_s, 0.28);
  EXPECT_EQ(read.arrivals[0].arrival_s, 0.301234);
  EXPECT_EQ(read.arrivals[1].quality, 20);
}

TEST(OutageList, MayNeverBeLiveAgain) {
  const test::TemporaryFolder folder;
  write_list(folder / "uniform.csv", {"drive", "", "uniform", "roaming-2", 1, INFINITY, 2, 5, {}});
  EXPECT_EQ(read_list(folder / "uniform.csv").live_again_s, INFINITY);
}

std::string complaint_about(const std::string& text) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "list.csv") << text;
  try {
    read_list(folder / "list.csv");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "none";
}

TEST(OutageList, WhatIsNoListIsRefusedByItsLine) {
  const std::string title = "# orbbuf outage list 1\n";
  EXPECT_THAT(complaint_about("image,number\n"), testing::HasSubstr("list.csv:1: not \"# orbbuf"));
  EXPECT_THAT(complaint_about(title + "# lateness_s soon\n"),
              testing::HasSubstr("list.csv:2: lateness_s: not a number"));
  EXPECT_THAT(complaint_about(title + "a.png,1,2.0\n"),
              testing::HasSubstr("list.csv:2: not image"));
  EXPECT_THAT(complaint_about(title + "../../a.png,1,2.0,3.0,80\n"),
              testing::HasSubstr("list.csv:2: not image"));
  EXPECT_EQ(complaint_about(title + "a.png,1,2.0,3.0,80\n"), "none");
}

TEST(Sha256, IsThatOfAllImagesInOrder) {
  const test::TemporaryFolder folder;
  std::filesystem::create_directory(folder / "images");
  std::ofstream(folder / "images/2.png") << "c";
  std::ofstream(folder / "images/1.png") << "ab";
  // printf abc | sha256sum
  EXPECT_EQ(sha256_of(images_of(folder.path())),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

}  // namespace
}  // namespace orbbuf::evaluation

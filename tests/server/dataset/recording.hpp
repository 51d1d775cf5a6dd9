// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "server/recording/session_files.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf::test {

/// A folder with one session in it, of real JPEGs: frames 0 to 9, of which 3, 4 and 7 were dropped.
class Recording : public testing::Test {
 protected:
  static constexpr int kWidth = 64;
  static constexpr int kHeight = 48;
  static constexpr int kFrames = 7;

  static const std::vector<Sequence>& delivered() {
    static const std::vector<Sequence> numbers = {0, 1, 2, 5, 6, 8, 9};
    return numbers;
  }

  static std::optional<Error> finish(SessionFiles& files, SessionClosing closing) {
    return files.finish(closing);
  }

  void record(bool is_stereo = false, const std::string& calibration = "") const {
    SessionFiles files(session_, calibration);
    for (const Sequence sequence : delivered()) {
      auto frame = jpeg_frame_ptr(sequence, kWidth, kHeight);
      if (is_stereo) {
        frame = stereo_frame_ptr(frame, jpeg_frame_ptr(sequence + 100, kWidth, kHeight));
      }
      ASSERT_FALSE(files.write(*frame));
    }
    ASSERT_FALSE(files.write_drops({0,
                                    {{4, 4 * kFrameNs, DropReason::kPolicy},
                                     {3, 3 * kFrameNs, DropReason::kBusy},
                                     {7, 7 * kFrameNs, DropReason::kFailed}}}));
    ASSERT_FALSE(finish(files, {true, wire::Stats{10, 1, 1, 1, 7, 0, 0}}));
  }

  TemporaryFolder folder_;
  std::filesystem::path session_ = folder_ / "session";
};

}  // namespace orbbuf::test

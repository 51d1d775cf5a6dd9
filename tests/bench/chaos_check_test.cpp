// SPDX-License-Identifier: Apache-2.0
// The check must find each fault, made by hand.
#include <gtest/gtest.h>

#include "bench/chaos/check.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf::chaos {
namespace {

namespace fs = std::filesystem;
using test::read_file;
using test::write_file;

constexpr const char* kHead = "sequence,reason,time\n";

/// Six frames of a source of four; 3 was dropped, the rest delivered.
class ChaosCheck : public ::testing::Test {
 protected:
  ChaosCheck() {
    for (const char* name : {"0", "1", "2", "3"}) {
      write_file(source_ / (std::string("00000") + name + ".jpg"), std::string("jpeg") + name);
    }
    for (const int frame : {0, 1, 2, 4, 5}) add_image(frame);
    write_file(session_.files / "times.txt", "0 0.0 1\n1 0.1 1\n2 0.2 1\n4 0.4 1\n5 0.5 1\n");
    write_drops("3,policy,0.3\n");
    write_log("6 = skipped 0 + failed 0 + dropped 1 + acknowledged 5 + waiting 0 + in flight 0");
  }

  static fs::path made(const fs::path& folder) {
    fs::create_directories(folder);
    return folder;
  }
  void add_image(int frame) {
    write_file(session_.files / "images" / ("00000" + std::to_string(frame) + ".jpg"),
               "jpeg" + std::to_string(frame % 4));
  }
  void write_drops(const std::string& lines) {
    write_file(session_.files / "drops.csv", kHead + lines);
  }
  void write_log(const std::string& closing) {
    write_file(session_.log,
               "now info [main] captured 4 skipped 0 failed 0 dropped 1 acknowledged 2 waiting 0 "
               "in flight 1\nnow info [main] session ended: captured " +
                   closing + "\n");
  }
  void write_log_of_killed(int captured) {
    write_file(session_.log, "now info [main] captured " + std::to_string(captured) +
                                 " skipped 0 failed 0 dropped 1 acknowledged 3 waiting " +
                                 std::to_string(captured - 4) + " in flight 0, no connection\n");
  }
  /// As a robot leaves it that is killed with 4 and 5 acknowledged and two more on the way.
  void kill() {
    session_.was_killed = true;
    write_file(session_.log,
               "now info [main] captured 8 skipped 0 failed 0 dropped 1 acknowledged 3 waiting 2 "
               "in flight 2, no connection\n");
  }
  CheckResult result() const { return check({session_}, source_); }

  test::TemporaryFolder folder_;
  fs::path source_ = made(folder_ / "source");
  Session session_{"r s", made(folder_ / "out/images").parent_path(), folder_ / "log"};
};

TEST_F(ChaosCheck, ASoundSessionHasNoProblem) {
  const CheckResult sound = result();
  EXPECT_EQ(sound.captured, 6U);
  EXPECT_EQ(sound.delivered, 5U);
  EXPECT_EQ(sound.dropped, 1U);
  EXPECT_EQ(sound.problems, std::vector<std::string>());
}

TEST_F(ChaosCheck, WithoutASourceOnlyTheImagesBytesAreNotJudged) {
  EXPECT_EQ(check({session_}, {}).problems, std::vector<std::string>());
  fs::remove(session_.files / "images/000002.jpg");
  EXPECT_EQ(check({session_}, {}).unexplained, 1U);
}

TEST_F(ChaosCheck, AFrameThatIsNowhereIsLost) {
  write_drops("");
  EXPECT_EQ(result().lost, 1U);
}

TEST_F(ChaosCheck, ALineTwiceIsARepeat) {
  write_file(session_.files / "times.txt",
             "0 0.0 1\n1 0.1 1\n1 0.1 1\n2 0.2 1\n4 0.4 1\n5 0.5 1\n");
  EXPECT_EQ(result().repeated, 1U);
}

TEST_F(ChaosCheck, DeliveredAndDroppedIsARepeat) {
  write_drops("3,policy,0.3\n4,policy,0.4\n");
  EXPECT_EQ(result().repeated, 1U);
}

TEST_F(ChaosCheck, AnImageOfOtherBytesIsUnexplained) {
  write_file(session_.files / "images/000004.jpg", "jpeg1");
  EXPECT_EQ(result().unexplained, 1U);
}

TEST_F(ChaosCheck, AReducedImageIsCheckedByWhatItWasMadeFrom) {
  write_file(session_.files / "images/000001.jpg", "jpg");
  const std::string head = "sequence,quality,whole_bytes,whole_crc\n";
  write_file(session_.files / "quality.csv", head + "0,80,0,00000000\n1,30,5,4BE1CCFC\n");
  EXPECT_EQ(result().unexplained, 0U);
  EXPECT_EQ(result().reduced, 1U);
  write_file(session_.files / "quality.csv", head + "1,30,5,00C0FFEE\n");
  EXPECT_EQ(result().unexplained, 1U);
}

TEST_F(ChaosCheck, AMissingImageIsUnexplained) {
  fs::remove(session_.files / "images/000004.jpg");
  EXPECT_EQ(result().unexplained, 1U);
}

TEST_F(ChaosCheck, AnImageWithoutALineIsUnexplained) {
  add_image(3);
  EXPECT_EQ(result().unexplained, 1U);
}

TEST_F(ChaosCheck, AnAccountThatDoesNotAddUpIsUnexplained) {
  write_log("6 = skipped 1 + failed 0 + dropped 1 + acknowledged 5 + waiting 0 + in flight 0");
  EXPECT_GE(result().unexplained, 1U);
}

TEST_F(ChaosCheck, WhatAKilledRobotHadYetToSendIsNamed) {
  kill();
  const CheckResult killed = result();
  EXPECT_EQ(killed.captured, 8U);
  EXPECT_EQ(killed.died_with_robot, 2U);
  EXPECT_EQ(killed.problems, std::vector<std::string>());
}

TEST_F(ChaosCheck, OfARobotThatLostItsPowerMoreMayBeNowhere) {
  kill();
  write_log_of_killed(300);
  EXPECT_EQ(result().died_with_robot, 100U);
  EXPECT_EQ(result().lost, 194U);
  session_.lost_power = true;
  EXPECT_EQ(result().died_with_robot, 140U);
  EXPECT_EQ(result().lost, 154U);
}

TEST_F(ChaosCheck, OneUnfinishedImageMayBeLeftOfAKilledRobot) {
  kill();
  add_image(6);
  EXPECT_EQ(result().unexplained, 0U);
  add_image(7);
  EXPECT_EQ(result().unexplained, 1U);
}

TEST_F(ChaosCheck, AFrameThatCameLateIsDeliveredAndNotNamed) {
  session_.has_spool = true;
  add_image(3);
  write_file(session_.files / "times.txt",
             "0 0.0 1\n1 0.1 1\n2 0.2 1\n3 0.3 1\n4 0.4 1\n5 0.5 1\n");
  EXPECT_EQ(result().repeated, 1U) << "it is still named";
  write_drops("");
  EXPECT_EQ(result().unexplained, 1U) << "the robot has acknowledged fewer frames";
  write_file(session_.files / "session.txt", "live 5\nlate 1\n");
  EXPECT_EQ(result().problems, std::vector<std::string>());
  EXPECT_EQ(result().late, 1U);
  EXPECT_EQ(result().delivered, 6U);
}

TEST_F(ChaosCheck, WithASpoolAFrameThatWasDroppedAndNeverCameIsLost) {
  session_.has_spool = true;
  EXPECT_EQ(result().lost, 1U);
  write_drops("3,busy,0.3\n");
  EXPECT_EQ(result().lost, 0U);
}

TEST_F(ChaosCheck, OfAKilledRobotOnlyItsLastFramesMayBeMissingFromTheSpool) {
  session_.has_spool = true;
  kill();
  EXPECT_EQ(result().lost, 0U);
  EXPECT_EQ(result().died_with_robot, 3U);  // frame 3, and two more
  write_file(session_.log,
             "now info [main] captured 200 skipped 0 failed 0 dropped 1 acknowledged 3 waiting 196 "
             "in flight 0, no connection\n");
  EXPECT_EQ(result().lost, 95U);  // 3 and 6 to 99
  session_.lost_power = true;
  EXPECT_EQ(result().lost, 55U);  // 3 and 6 to 59
}

}  // namespace
}  // namespace orbbuf::chaos

// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/socket_samples.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <optional>
#include <stdexcept>

#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

using ::testing::ElementsAre;
using Datagrams = boost::asio::local::datagram_protocol;

class SocketSamplesTest : public ::testing::Test {
 protected:
  void send(std::string_view text) {
    Datagrams::socket driver(io_, Datagrams());
    driver.connect(settings_.path.string());
    driver.send(boost::asio::buffer(text));
  }
  SampleSource::Take take() {
    return [this](const Sample& sample) { times_.push_back(sample.time_ns); };
  }
  void run_until(std::size_t samples) {
    while (times_.size() < samples) io_.run_one();
  }

  const test::TemporaryFolder folder_;
  const SampleStreamSettings settings_{"imu0", "socket", folder_ / "imu"};
  boost::asio::io_context io_;
  std::vector<std::int64_t> times_;
};

TEST_F(SocketSamplesTest, TakesTheLinesOfAllDriversAndIgnoresWhatIsNoSample) {
  const SocketSamples source(io_, settings_, take());
  send("10,1,2,3,4,5,6\n20,1,2,3,4,5,6\n");
  send("nonsense\n\n30,1,2,3,4,5,nan\n40,1,2,3,4,5,6");
  send(std::string(1000, ','));
  send("50,1,2,3,4,5,6\r\n");
  run_until(4);
  EXPECT_THAT(times_, ElementsAre(10, 20, 40, 50));
}

TEST_F(SocketSamplesTest, NothingRunsAfterItsEnd) {
  std::optional<SocketSamples> source;
  source.emplace(io_, settings_, take());
  send("10,1,2,3,4,5,6");
  send("20,1,2,3,4,5,6");
  run_until(1);  // Asio has read the second, and queued its handler
  source.reset();
  io_.run();
  EXPECT_THAT(times_, ElementsAre(10));
}

TEST_F(SocketSamplesTest, AFileInItsPlaceIsAnErrorAndStays) {
  std::ofstream(settings_.path) << "a recording";
  EXPECT_THROW(SocketSamples(io_, settings_, take()), std::runtime_error);
  EXPECT_TRUE(std::filesystem::is_regular_file(settings_.path));
}

TEST_F(SocketSamplesTest, WhoMayEnterTheFolderMayWrite) {
  const SocketSamples source(io_, settings_, take());
  struct stat status {};
  ASSERT_EQ(::stat(settings_.path.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0666U);
}

TEST_F(SocketSamplesTest, ReplacesADeadSocketAndLeavesALivingOneAlone) {
  { Datagrams::socket dead(io_, Datagrams::endpoint(settings_.path.string())); }
  const SocketSamples source(io_, settings_, take());
  EXPECT_THROW(SocketSamples(io_, settings_, take()), std::runtime_error);
  send("10,1,2,3,4,5,6");
  run_until(1);
}

TEST_F(SocketSamplesTest, SaysWhereItCannotListen) {
  try {
    const SocketSamples source(io_, {"imu0", "socket", folder_ / "none/imu"}, take());
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(),
                ::testing::HasSubstr("imu0: listen on " + settings_.path.parent_path().string()));
  }
}

TEST_F(SocketSamplesTest, RemovesItsSocketAtTheEnd) {
  { const SocketSamples source(io_, settings_, take()); }
  EXPECT_FALSE(std::filesystem::exists(settings_.path));
  io_.run();
}

}  // namespace
}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
// Any bytes, over one or two connections, against the server's real Connection and Session. The
// first byte is how many bytes are written at a time, the second where the first connection's part
// ends (in 256ths of the rest) and the second connection comes to replace it.
#include <sys/socket.h>

#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <cstdlib>
#include <map>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "common/log.hpp"
#include "common/unique_fd.hpp"
#include "server/link/connection.hpp"
#include "tests/fuzz/stream_mutator.hpp"

namespace orbbuf {
namespace {

using Bytes = std::span<const std::uint8_t>;
using Tcp = boost::asio::ip::tcp;

void require(bool holds) {
  if (!holds) std::abort();
}

/// Takes everything, a turn of the loop later, and sees to it that nothing comes twice.
class CheckingSink final : public FrameSink {
 public:
  explicit CheckingSink(boost::asio::io_context& main) : main_(main) {}

  void async_write(FramePtr frame, Done done) override {
    require(!is_busy_ && frame->sequence >= next_ && !frame->jpeg.empty());
    next_ = frame->sequence + 1;
    finish(std::move(done));
  }
  bool takes_items() const override { return true; }
  void async_write_items(ItemsPtr items, Done done) override {
    require(!is_busy_ && items->stream == wire::kDrops && items->first >= next_drop_);
    next_drop_ = items->first + wire::parse_drops(items->payload).value().size();
    finish(std::move(done));
  }

 private:
  void finish(Done done) {
    is_busy_ = true;
    boost::asio::post(main_, [this, done = std::move(done)] {
      is_busy_ = false;
      done(std::nullopt);
    });
  }

  boost::asio::io_context& main_;
  Sequence next_ = 0;
  std::uint64_t next_drop_ = 0;
  bool is_busy_ = false;
};

/// As much of the server as one robot's connections need.
class World final : public ConnectionOwner {
 public:
  /// The robot's end of a new connection.
  UniqueFd connect() {
    std::array<int, 2> ends{};
    require(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) == 0);
    Tcp::socket socket(main_);
    socket.assign(Tcp::v4(), ends[1]);
    auto connection = std::make_shared<Connection>(std::move(socket), nullptr, settings_, *this);
    connection->start();
    return UniqueFd(ends[0]);
  }

  void write(const UniqueFd& robot, Bytes bytes, std::size_t step) {
    while (!bytes.empty()) {
      const auto piece = bytes.first(std::min(step, bytes.size()));
      const auto count =
          ::send(robot.get(), piece.data(), piece.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
      settle();
      if (count <= 0) return;  // the server has closed it
      bytes = bytes.subspan(static_cast<std::size_t>(count));
    }
  }

  void settle() {
    main_.restart();
    main_.poll();
  }

 private:
  void on_hello(const std::shared_ptr<Connection>& connection, const wire::Hello& hello) override {
    auto& session = sessions_[{hello.robot_id, hello.session_id}];
    if (!session) {
      auto sink = std::make_shared<CheckingSink>(main_);
      session = std::make_shared<Session>(
          main_, SessionInfo{hello.robot_id, hello.session_id, hello.calibration},
          std::vector<std::shared_ptr<FrameSink>>{sink},
          Session::Timeouts{std::chrono::hours(1), std::chrono::hours(1)},
          Session::Events{[] {}, {}});
    }
    if (session->is_closing()) return connection->refuse("closing");
    connection->join(session);
  }
  SessionStores* stores() override { return nullptr; }
  void on_closed(const std::shared_ptr<Connection>& /*connection*/) override {}

  boost::asio::io_context main_{1};  // ends last: timers of all the rest are in it
  ListenSettings settings_{.max_frame_bytes = 1 << 16};
  std::map<std::pair<std::string, std::string>, std::shared_ptr<Session>> sessions_;
};

void run(Bytes input) {
  if (input.size() < 2) return;
  const std::size_t step = 1 + 16UL * input[0];
  const Bytes stream = input.subspan(2);
  const Bytes first = stream.first(stream.size() * input[1] / 256);
  World world;
  const UniqueFd one = world.connect();
  world.write(one, first, step);
  const UniqueFd two = world.connect();
  world.write(two, stream.subspan(first.size()), step);
}

}  // namespace
}  // namespace orbbuf

extern "C" int LLVMFuzzerInitialize(int* /*argc*/, char*** /*argv*/) {
  orbbuf::set_up_log("error");
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  orbbuf::run({data, size});
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t max_size, unsigned seed) {
  return orbbuf::test::mutate_stream(data, size, max_size, 2, seed);
}

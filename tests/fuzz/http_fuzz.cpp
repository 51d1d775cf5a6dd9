// SPDX-License-Identifier: Apache-2.0
// Any bytes as a browser's, cut into requests and answered by the real site, which shows one robot.
// The first byte is how many come at a time.
#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <cstdlib>
#include <span>

#include "server/http/request_reader.hpp"
#include "server/http/router.hpp"

namespace orbbuf {
namespace {

void require(bool holds) {
  if (!holds) std::abort();
}

/// A site whose disk, which holds nothing, is as fast as its `main`.
class World {
 public:
  World() {
    const auto robot = metrics_.begin({"r", "s", ""});
    robot->on_connected();
    robot->on_report({{3, 0, 0, 1, 1, 1, 0}, 25, 1000, 1'000'000, 40'000});
    robot->on_dropped(std::vector<DropRecord>(1));
    EncodedFrame frame;
    frame.jpeg = {0xFF, 0xD8, 0xFF, 0xD9};
    robot->on_delivered(std::make_shared<const EncodedFrame>(frame));
  }

  void answer(const HttpRequest& request) {
    router_.answer(request, [](const HttpResponse& response) {
      require(response.status >= 200 && response.status < 500 && !response.file);
      const std::string head = head_of(response, true);
      require(head.ends_with("\r\n\r\n") && head.find("\r\n\r\n") == head.size() - 4);
    });
    main_.restart();
    main_.poll();
  }

 private:
  boost::asio::io_context main_{1};
  boost::asio::thread_pool files_{1};
  Metrics metrics_{4};
  Router router_{main_, boost::asio::make_strand(files_), metrics_, "/nonexistent", true};
};

void run(std::span<const std::uint8_t> input) {
  static World world;
  if (input.empty()) return;
  const std::size_t step = std::max<std::size_t>(1, input[0]);
  RequestReader reader;
  for (auto rest = input.subspan(1); !rest.empty() && reader.fault() == 0;) {
    const auto piece = rest.first(std::min(step, rest.size()));
    reader.add(piece);
    rest = rest.subspan(piece.size());
    while (const auto request = reader.next()) world.answer(*request);
  }
  require(reader.fault() == 0 || !reader.next());
}

}  // namespace
}  // namespace orbbuf

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  orbbuf::run({data, size});
  return 0;
}

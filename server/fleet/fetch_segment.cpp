// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/fetch_segment.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <fstream>
#include <memory>

#include "common/journal/journal.hpp"
#include "server/fleet/etcd_client.hpp"
#include "server/fleet/page_client.hpp"
#include "server/session/session_names.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf::fleet {
namespace {

namespace asio = boost::asio;
namespace fs = std::filesystem;

/// A server's page, whose answers are waited for.
class Page {
 public:
  explicit Page(Address address) : client_(std::make_shared<PageClient>(io_, std::move(address))) {}

  /// Nothing: there is no such file.
  Result<std::optional<std::string>> get(std::string path) {
    std::optional<Result<std::optional<std::string>>> answer;
    client_->async_get(std::move(path), [&](auto got) { answer = std::move(got); });
    io_.restart();
    while (!answer) io_.run_one();
    return *std::move(answer);
  }

 private:
  asio::io_context io_;
  std::shared_ptr<PageClient> client_;
};

std::optional<Error> keep(const fs::path& path, const std::string& content) {
  std::error_code ignored;  // then writing says why
  fs::create_directories(path.parent_path(), ignored);
  std::ofstream out(path, std::ios::binary);
  if (out << content && out.flush()) return std::nullopt;
  return system_error("write " + path.string(), errno);
}

/// False: it is missing.
Result<bool> fetch(Page& page, const std::string& from, const std::string& name,
                   const fs::path& to) {
  const auto content = page.get(from + name);
  if (!content) return content.error();
  if (!content.value()) return false;
  if (auto error = keep(to / name, *content.value())) return std::move(*error);
  return true;
}

}  // namespace

std::string page_path(const std::string& robot_id, const std::string& folder) {
  return fmt::format("/sessions/{}/{}/", robot_id, folder);
}

void async_find_session(KeyStore& store, const SessionName& session,
                        const std::function<void(Result<FoundSession>)>& done) {
  store.async_txns({{{}, {}, {session.owner_key()}}}, [&store, session, done](auto outcomes) {
    if (!outcomes) return done(outcomes.error());
    const auto& found = outcomes.value().front().found;
    const auto owner = found.empty() ? std::nullopt : owner_from(found.front().value);
    if (!owner) return done(Error{"etcd: no session " + session.text()});
    store.async_range(KeyRange(kServers), [owner, done](auto keys) {
      if (!keys) return done(keys.error());
      FoundSession answer;
      for (const KeyValue& key : keys.value()) {
        if (auto server = server_from(key.key, key.value)) {
          answer.servers.push_back(std::move(*server));
        }
      }
      for (const Segment& segment : owner->segments) {
        const auto server = std::ranges::find(answer.servers, segment.server, &ServerEntry::name);
        answer.segments.push_back({segment, server == answer.servers.end() ? "" : server->http});
      }
      done(std::move(answer));
    });
  });
}

Result<FoundSession> find_session(const std::vector<Address>& etcd, const SessionName& session) {
  asio::io_context io;
  EtcdClient client(io, {etcd, {}});
  std::optional<Result<FoundSession>> answer;
  async_find_session(client, session, [&](auto found) { answer = std::move(found); });
  io.run();
  return *std::move(answer);
}

Result<std::string> fetch_file(const Address& address, const std::string& robot_id,
                               const std::string& folder, const std::string& file) {
  auto content = Page(address).get(page_path(robot_id, folder) + file);
  if (!content) return std::move(content).error();
  return std::move(content).value().value_or("");
}

std::optional<Error> fetch_segment(const Address& address, const std::string& robot_id,
                                   const std::string& folder, const fs::path& to) {
  Page page(address);
  const std::string from = page_path(robot_id, folder);
  for (std::uint32_t segment = 0;; ++segment) {
    const auto is_there = fetch(page, from, journal::segment_path("", segment).string(), to);
    if (!is_there) return is_there.error();
    if (!is_there.value()) break;
  }
  if (!fs::exists(to)) return std::nullopt;
  std::optional<Error> failed;
  const auto fetch_image = [&](const std::string& image) {
    if (failed) return;
    if (const auto got = fetch(page, from, image, to); !got) failed = got.error();
  };
  const auto outline = read_outline(to);
  if (!outline) return outline.error();
  const auto drops = for_each_frame(to, outline.value(), [&](const RecordedFrame& frame) {
    fetch_image(session_names::left_image(frame.sequence));
    if (frame.is_stereo()) fetch_image(session_names::right_image(frame.sequence));
  });
  return !drops ? drops.error() : failed;
}

}  // namespace orbbuf::fleet

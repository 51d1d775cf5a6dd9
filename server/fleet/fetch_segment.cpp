// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/fetch_segment.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <fstream>
#include <memory>
#include <sstream>

#include "server/fleet/etcd_client.hpp"
#include "server/fleet/page_client.hpp"
#include "server/recording/session_lines.hpp"
#include "server/recording/session_names.hpp"

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

/// Nothing if it is missing.
Result<std::string> fetch(Page& page, const std::string& from, const std::string& name,
                          const fs::path& to) {
  auto content = page.get(from + name);
  if (!content) return std::move(content).error();
  if (!content.value()) return std::string();
  if (auto error = keep(to / name, *content.value())) return std::move(*error);
  return std::move(*content.value());
}

/// Late frames that are not merged yet, before what is merged: none is missed in between.
std::optional<Error> fetch_late(Page& page, const std::string& from, const fs::path& to) {
  const auto list = fetch(page, from, session_names::kLateList, to);
  if (!list) return list.error();
  std::istringstream lines(list.value());
  for (std::string line; std::getline(lines, line);) {
    const auto late = session_lines::parse_late(line);
    if (!late) continue;
    for (const std::string& image :
         {session_names::left_image(late->sequence), session_names::right_image(late->sequence)}) {
      const auto got = fetch(page, from, session_names::late_image(image), to);
      if (!got) return got.error();
      if (!late->crc_right) break;
    }
  }
  return std::nullopt;
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
    store.async_range(std::string(kServers), [owner, done](auto keys) {
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
  if (auto error = fetch_late(page, from, to)) return error;
  std::string checksums;
  for (const char* const name :
       {session_names::kTimes, session_names::kDrops, session_names::kCamera, session_names::kEnd,
        session_names::kSegment, session_names::kQualities, session_names::kChecksums}) {
    auto content = fetch(page, from, name, to);
    if (!content) return std::move(content).error();
    checksums = std::move(content).value();
  }
  std::istringstream lines(checksums);
  for (std::string line; std::getline(lines, line);) {
    const std::string image = line.substr(0, line.rfind(' '));
    const bool is_image = image.starts_with("images/") || image.starts_with("images_right/");
    if (!is_image || image.find("..") != std::string::npos) continue;
    if (auto content = fetch(page, from, image, to); !content) return std::move(content).error();
  }
  return std::nullopt;
}

}  // namespace orbbuf::fleet

// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/overview.hpp"

#include <nlohmann/json.hpp>
#include <utility>

#include "server/fleet/fleet_keys.hpp"

namespace orbbuf::fleet {

using nlohmann::json;

void Overview::async_page(const std::string& from, const Done& done) {
  const auto now = Clock::now();
  std::erase_if(pages_, [now](const auto& entry) {
    return entry.second.read_at && now - *entry.second.read_at >= kFresh;
  });
  const auto first = session_of(std::string(kSessions) + from) ? from : std::string();
  Page& page = pages_[first];
  if (page.read_at) return done(page.json);
  page.waiting.push_back(done);
  if (page.waiting.size() == 1) read(first);
}

void Overview::read(const std::string& from) {
  const auto get = [this, from](std::string_view prefix, std::size_t most, auto use) {
    const KeyRange range(prefix, most == 0 ? "" : from, most);
    store_.async_range(range, [this, from, use = std::move(use)](Result<Keys> found) {
      if (!found) return finish(from, found.error());
      use(std::move(found).value());
    });
  };
  get(kServers, 0, [this, from, get](const Keys& servers) {
    get(kSessions, kPage + 1, [this, from, get, servers](const Keys& owners) {
      get(kPositions, kPage + 1, [this, from, servers, owners](const Keys& positions) {
        finish(from, to_json(servers, owners, positions));
      });
    });
  });
}

void Overview::finish(const std::string& from, const Result<std::string>& text) {
  auto page = std::move(pages_.extract(from).mapped());
  const auto waiting = std::exchange(page.waiting, {});
  if (text) {
    page.json = text.value();
    page.read_at = Clock::now();
    pages_.emplace(from, std::move(page));
  }
  for (const Done& done : waiting) done(text);
}

std::string Overview::to_json(const Keys& servers, Keys owners, const Keys& positions) const {
  json page{{"etcd", json::array()}, {"servers", json::array()}, {"sessions", json::array()}};
  for (const Address& endpoint : etcd_) page["etcd"].push_back(to_string(endpoint));
  for (const KeyValue& key : servers) {
    const auto server = server_from(key.key, key.value);
    if (!server) continue;
    json& entry = page["servers"].emplace_back(json::parse(to_text(*server)));
    entry["name"] = server->name;
    entry.erase("place");
  }
  if (owners.size() > kPage) {
    if (const auto next = session_of(owners.back().key)) page["next"] = next->text();
    owners.pop_back();
  }
  std::map<std::string, const std::string*> position_of;
  for (const KeyValue& key : positions) position_of[key.key] = &key.value;
  for (const KeyValue& key : owners) {
    const auto name = session_of(key.key);
    const auto owner = owner_from(key.value);
    if (!name || !owner) continue;
    json& entry = page["sessions"].emplace_back(json::parse(to_text(*owner)));
    entry["robot"] = name->robot_id;
    entry["session"] = name->session_id;
    const auto found = position_of.find(name->position_key());
    const auto position = found == position_of.end() ? std::nullopt : position_from(*found->second);
    if (position) entry.update(json::parse(to_text(*position)));
  }
  return page.dump();
}

}  // namespace orbbuf::fleet

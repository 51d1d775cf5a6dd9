// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/address.hpp"
#include "common/error.hpp"
#include "server/fleet/fleet_keys.hpp"
#include "server/fleet/key_store.hpp"

namespace orbbuf::fleet {

/// A segment of a session, and where the page of its server is.
struct FoundSegment {
  Segment segment;
  std::string http;  ///< empty: the server does not live, or has no page
};

/// What etcd knows of a session.
struct FoundSession {
  std::vector<FoundSegment> segments;
  std::vector<ServerEntry> servers;  ///< those that live, whether or not they have any of it
};

/// An error also if etcd knows of no such session. `done` as in KeyStore, which must outlive that.
void async_find_session(KeyStore& store, const SessionName& session,
                        const std::function<void(Result<FoundSession>)>& done);
/// The same. Blocking.
Result<FoundSession> find_session(const std::vector<Address>& etcd, const SessionName& session);

/// Where a page has the files of a robot's folder; ends with a slash.
std::string page_path(const std::string& robot_id, const std::string& folder);

/// A file of that folder, as a server's page shows it; empty: there is none. Blocking.
Result<std::string> fetch_file(const Address& page, const std::string& robot_id,
                               const std::string& folder, const std::string& file);

/// Copies the journal of a folder of that robot and its images, as a server's page shows them, to
/// `to`; nothing if it has no such folder. Plain HTTP. Blocking.
std::optional<Error> fetch_segment(const Address& page, const std::string& robot_id,
                                   const std::string& folder, const std::filesystem::path& to);

}  // namespace orbbuf::fleet

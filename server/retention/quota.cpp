// SPDX-License-Identifier: Apache-2.0
#include "server/retention/quota.hpp"

#include <algorithm>
#include <tuple>

namespace orbbuf {

std::vector<KeptSession> over_quota(std::vector<KeptSession> sessions, const Quota& quota,
                                    std::chrono::system_clock::time_point now,
                                    const std::function<bool(const KeptSession&)>& is_finished) {
  std::ranges::sort(sessions, [](const KeptSession& a, const KeptSession& b) {
    return std::tie(a.last_write, a.session_id) < std::tie(b.last_write, b.session_id);
  });
  std::uint64_t bytes = 0;
  for (const KeptSession& session : sessions) bytes += session.bytes;
  std::vector<KeptSession> going;
  for (std::size_t i = 0; i < sessions.size(); ++i) {
    const bool is_newest = i + 1 == sessions.size();
    const bool is_too_old = quota.age.count() > 0 && now - sessions[i].last_write > quota.age;
    const bool is_too_much = quota.bytes > 0 && bytes > quota.bytes && !is_newest;
    if ((!is_too_old && !is_too_much) || !is_finished(sessions[i])) continue;
    bytes -= sessions[i].bytes;
    going.push_back(sessions[i]);
  }
  return going;
}

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "server/http/response.hpp"
#include "server/live/metrics.hpp"

/// What a browser or Prometheus is shown (docs/live-page.md).
namespace orbbuf {

/// Whether all streams flow: 200 and `ok`, or 503 and a line for each whose sink fails.
HttpResponse health(const Metrics& metrics);

/// The one page there is, with its style and its script in it: what it shows depends on the path.
/// Its policy of contents allows these two, by their hashes, and what this server sends; nothing
/// else.
HttpResponse page();

/// All robots, as JSON. Of the timelines the seconds that have changed since `since_ms`, which is
/// what an earlier answer gave as its `clock_ms`.
std::string to_json(const Metrics& metrics, std::uint64_t since_ms, RobotMetrics::Time now);

/// One of them, without its timeline.
std::string to_json(const RobotMetrics& robot, RobotMetrics::Time now);
inline constexpr std::string_view kRobotSchemaName = "orbbuf.Robot";
/// Of that, as a JSON schema.
std::string robot_schema();

/// `{"names":[...]}`: the folders in `folder` that are named like robots or sessions, in reverse
/// order, so the newest of those that begin with their time comes first; at most a thousand.
/// Nothing if there is no such folder. Blocking, as is the next.
std::optional<std::string> folders_json(const std::filesystem::path& folder);

/// What a session's folder holds: the bytes of each of its lists, null where it is missing.
std::optional<std::string> session_json(const std::filesystem::path& folder);

inline constexpr std::string_view kMetricsType = "text/plain; version=0.0.4; charset=utf-8";

/// The metrics in Prometheus' text format; docs/live-page.md lists the names.
std::string to_prometheus(const Metrics& metrics, RobotMetrics::Time now);

}  // namespace orbbuf

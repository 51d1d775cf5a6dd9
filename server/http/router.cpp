// SPDX-License-Identifier: Apache-2.0
#include "server/http/router.hpp"

#include <algorithm>
#include <cstdint>
#include <string_view>
#include <utility>

#include "common/calibration/calibration.hpp"
#include "common/decimal.hpp"
#include "common/journal/journal.hpp"
#include "common/wire.hpp"
#include "server/http/views.hpp"
#include "server/runtime/run_in_pool.hpp"
#include "server/session/session_names.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
namespace fs = std::filesystem;

constexpr unsigned kMethodNotAllowed = 405;
constexpr unsigned kMisdirected = 421;
constexpr std::string_view kJson = "application/json";
constexpr std::string_view kJpeg = "image/jpeg";

std::vector<std::string> words_of(std::string_view path) {
  std::vector<std::string> words;
  while (!path.empty()) {
    path.remove_prefix(1);  // the slash
    const std::size_t end = std::min(path.find('/'), path.size());
    words.emplace_back(path.substr(0, end));
    path.remove_prefix(end);
  }
  if (words.size() > 1 && words.back().empty()) words.pop_back();
  return words;
}

/// What is behind `key`; empty if the query does not begin with it.
std::string_view value_of(std::string_view query, std::string_view key) {
  return query.starts_with(key) ? query.substr(key.size()) : std::string_view();
}

/// The number behind `since=`; 0 if there is none.
std::uint64_t since(std::string_view query) {
  return parse_digits(value_of(query, "since=")).value_or(0);
}

bool is_image_name(std::string_view name) {
  constexpr std::string_view kEnd = ".jpg";
  return name.ends_with(kEnd) && parse_digits(name.substr(0, name.size() - kEnd.size()));
}

bool is_journal_name(std::string_view name) {
  const auto number = parse_number<std::uint32_t>(name.substr(name.find('.') + 1));
  return number && name == journal::segment_path("", *number).string();
}

/// What is behind the ids in a path, as a path in the session's folder; empty if it is nothing that
/// is shown. Only what SessionStore writes, so no word can lead elsewhere.
fs::path file_in_session(const std::vector<std::string>& words) {
  if (words.size() == 4) {
    for (const char* name :
         {session_names::kTimes, session_names::kDrops, kCameraFile, kKalibrFile,
          session_names::kChecksums, session_names::kQualities, session_names::kSession}) {
      if (words[3] == name) return name;
    }
    if (is_journal_name(words[3])) return words[3];
  }
  if (words.size() == 5 && is_image_name(words[4])) {
    for (const char* folder : {session_names::kImages, session_names::kRightImages}) {
      if (words[3] == folder) return fs::path(folder) / words[4];
    }
  }
  return {};
}

}  // namespace

Router::Router(asio::io_context& main, PoolStrand files, const Metrics& metrics, fs::path folder,
               bool is_local)
    : main_(main),
      files_(std::move(files)),
      metrics_(metrics),
      folder_(std::move(folder)),
      is_local_(is_local) {}

void Router::answer(const HttpRequest& request, Answer answer) const {
  if (!is_for_this_host(request)) {
    return answer(error_response(kMisdirected, "ask for localhost, or for an address"));
  }
  if (!request.is_get) return answer(error_response(kMethodNotAllowed));
  answer_path(request, words_of(request.path), std::move(answer));
}

bool Router::is_for_this_host(const HttpRequest& request) const {
  return !is_local_ || is_own_host(request.host);
}

void Router::answer_path(const HttpRequest& request, const Words& words, Answer answer) const {
  const std::string& first = words.front();
  if (first == "healthz" && words.size() == 1) return answer(health(metrics_));
  if (first == "metrics" && words.size() == 1) return answer(prometheus());
  if (first == "robots" && words.size() == 3 && words[2] == "image") return answer(image(words[1]));
  if (first == "api" && words.size() == 2 && words[1] == "robots") {
    return answer(robots(request.query));
  }
  if (first == "api" && words.size() >= 2 && words.size() <= 4 && words[1] == "sessions") {
    return sessions(words, std::move(answer));
  }
  if (first == "sessions" && words.size() > 3) return session_file(words, std::move(answer));
  const bool is_page = first == "sessions" || (first.empty() && words.size() == 1);
  if (is_page && words.size() <= 3) return answer(page());
  answer(error_response(kNotFound));
}

HttpResponse Router::prometheus() const {
  return text_response(to_prometheus(metrics_, RobotMetrics::Clock::now()), kMetricsType);
}

HttpResponse Router::robots(const std::string& query) const {
  return text_response(to_json(metrics_, since(query), RobotMetrics::Clock::now()), kJson);
}

HttpResponse Router::image(const std::string& robot) const {
  const auto entry = metrics_.robots().find(robot);
  if (entry == metrics_.robots().end() || !entry->second->newest()) {
    return error_response(kNotFound, "no frame of such a robot");
  }
  HttpResponse response;
  response.type = kJpeg;
  response.image = entry->second->newest();
  return response;
}

void Router::session_file(const Words& words, Answer answer) const {
  const fs::path file = file_in_session(words);
  if (folder_.empty() || file.empty() || !wire::is_valid_id(words[1]) ||
      !wire::is_valid_id(words[2])) {
    return answer(error_response(kNotFound));
  }
  const std::string_view type =
      words.size() >= 5 ? kJpeg : std::string_view("text/plain; charset=utf-8");
  run_on_files(
      [path = folder_ / words[1] / words[2] / file, type] {
        HttpResponse response;
        response.type = type;
        response.file = ServedFile::open(path);
        return response.file ? response : error_response(kNotFound);
      },
      std::move(answer));
}

/// /api/sessions, with a robot, and with a session of it.
void Router::sessions(const Words& words, Answer answer) const {
  const bool is_valid = std::all_of(words.begin() + 2, words.end(),
                                    [](const auto& id) { return wire::is_valid_id(id); });
  if (!is_valid || folder_.empty()) return answer(error_response(kNotFound));
  fs::path path = folder_;
  for (std::size_t i = 2; i < words.size(); ++i) path /= words[i];
  const bool is_session = words.size() == 4;
  run_on_files(
      [path, is_session] {
        const auto json = is_session ? session_json(path) : folders_json(path);
        return json ? text_response(*json, kJson) : error_response(kNotFound);
      },
      std::move(answer));
}

void Router::run_on_files(std::function<HttpResponse()> work, Answer answer) const {
  run_in_pool(main_, files_, std::move(work), std::move(answer));
}

}  // namespace orbbuf

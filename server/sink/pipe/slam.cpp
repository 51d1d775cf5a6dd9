// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe/slam.hpp"

#include <string_view>
#include <vector>

#include "server/sink/pipe/fifo.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;

/// Every occurrence; `value` is not searched again.
void replace_all(std::string& text, std::string_view placeholder, const std::string& value) {
  for (std::size_t at = text.find(placeholder); at != std::string::npos;
       at = text.find(placeholder, at + value.size())) {
    text.replace(at, placeholder.size(), value);
  }
}

std::string filled_in(std::string text, const SessionInfo& info) {
  replace_all(text, "{robot}", info.robot_id);
  replace_all(text, "{session}", info.session_id);
  return text;
}

std::unique_ptr<PipeReader> make_reader(const SlamSettings& settings, const SessionInfo& info,
                                        asio::io_context& main) {
  if (!settings.fifo.empty()) {
    return std::make_unique<Fifo>(filled_in(settings.fifo.string(), info));
  }
  return std::make_unique<ChildProcess>(
      main, info.robot_id + " " + info.session_id, filled_in(settings.command, info),
      std::vector{"ORBBUF_ROBOT=" + info.robot_id, "ORBBUF_SESSION=" + info.session_id},
      settings.restart);
}

WithoutReader without_reader(const SlamSettings& settings, bool is_kept) {
  if (!is_kept) return WithoutReader::kHold;
  return settings.resume == Resume::kBacklog ? WithoutReader::kCatchUp : WithoutReader::kPass;
}

}  // namespace

std::shared_ptr<FrameSink> make_slam_sink(const SlamSettings& settings, const SessionInfo& info,
                                          const std::optional<KeptFrames>& kept,
                                          asio::io_context& main, asio::thread_pool& pool) {
  auto pipe = std::make_shared<PipeSink>(
      main, pool, info, make_reader(settings, info, main), settings.format,
      without_reader(settings, kept.has_value()), kept.value_or(KeptFrames{}));
  pipe->start();
  return pipe;
}

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#include "server/sink/make_sinks.hpp"

#include <unistd.h>

#include <string_view>
#include <system_error>
#include <utility>

#include "server/sink/child_process.hpp"
#include "server/sink/fifo.hpp"
#include "server/sink/file_sink.hpp"
#include "server/sink/mcap_recording.hpp"
#include "server/sink/session_files.hpp"

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

std::unique_ptr<PipeReader> make_reader(const SinkSettings& settings, const SessionInfo& info,
                                        asio::io_context& main) {
  if (!settings.fifo.empty()) {
    return std::make_unique<Fifo>(filled_in(settings.fifo.string(), info));
  }
  return std::make_unique<ChildProcess>(
      main, filled_in(settings.command, info),
      std::vector{"ORBBUF_ROBOT=" + info.robot_id, "ORBBUF_SESSION=" + info.session_id});
}

/// The recording before the files: McapRecording::recover() relies on it.
std::optional<Error> add_records(const SinkSettings& settings, const SessionInfo& info,
                                 asio::io_context& main, asio::thread_pool& pool,
                                 std::vector<std::shared_ptr<FrameSink>>& sinks) {
  const auto folder = settings.files_path / info.robot_id / info.session_id;
  std::shared_ptr<FrameSink> files_sink;
  std::optional<wire::Position> held;
  if (settings.files_enabled) {
    auto files = std::make_unique<SessionFiles>(folder, info.calibration);
    auto position = files->recover();
    if (!position) return std::move(position).error();
    held = position.value();
    files_sink = std::make_shared<FileSink>(main, pool, std::move(files), *held);
  }
  if (settings.mcap_enabled) {
    auto recording = std::make_unique<McapRecording>(folder / (info.session_id + ".mcap"), info);
    auto position = recording->recover(held);
    if (!position) return std::move(position).error();
    sinks.push_back(std::make_shared<FileSink>(main, pool, std::move(recording), position.value()));
  }
  if (files_sink) sinks.push_back(std::move(files_sink));
  return std::nullopt;
}

}  // namespace

void check_sinks(const SinkSettings& settings) {
  if (!settings.files_enabled && !settings.mcap_enabled) return;
  std::error_code ignored;  // access() says why
  std::filesystem::create_directories(settings.files_path, ignored);
  if (::access(settings.files_path.c_str(), W_OK | X_OK) != 0) {
    throw_system_error("write files to " + settings.files_path.string());
  }
}

Result<std::vector<std::shared_ptr<FrameSink>>> make_sinks(const SinkSettings& settings,
                                                           const SessionInfo& info,
                                                           asio::io_context& main,
                                                           asio::thread_pool& pool) {
  std::vector<std::shared_ptr<FrameSink>> sinks;
  if (auto error = add_records(settings, info, main, pool, sinks)) return std::move(*error);
  if (!settings.fifo.empty() || !settings.command.empty()) {
    auto pipe = std::make_shared<PipeSink>(
        main, pool, info.robot_id + " " + info.session_id, make_reader(settings, info, main),
        settings.pipe_format, sinks.empty() ? WithoutReader::kHold : WithoutReader::kPass);
    pipe->start();
    sinks.push_back(std::move(pipe));
  }
  return sinks;
}

}  // namespace orbbuf

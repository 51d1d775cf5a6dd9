// SPDX-License-Identifier: Apache-2.0
#include "testing/captured_log.hpp"

#include <fmt/format.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <stdexcept>

namespace orbbuf::test {

class CapturedLog::Sink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  std::vector<std::string> lines(const std::string& text) {
    const std::lock_guard lock(mutex_);
    return found(text);
  }
  void wait_for(const std::string& text, std::size_t times) {
    std::unique_lock lock(mutex_);
    const auto is_there = [&] { return found(text).size() >= times; };
    if (grown_.wait_for(lock, std::chrono::minutes(1), is_there)) return;
    throw std::runtime_error(fmt::format("no line {} of the log contains \"{}\":\n{}", times, text,
                                         fmt::join(lines_, "\n")));
  }

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    spdlog::memory_buf_t line;
    formatter_->format(message, line);
    lines_.emplace_back(line.data(), line.size() - 1);  // without the line's end
    grown_.notify_all();
  }
  void flush_() override {}
  std::vector<std::string> found(const std::string& text) const {
    std::vector<std::string> found;
    for (const std::string& line : lines_) {
      if (line.find(text) != std::string::npos) found.push_back(line);
    }
    return found;
  }

  std::vector<std::string> lines_;
  std::condition_variable grown_;
};

CapturedLog::CapturedLog() : sink_(std::make_shared<Sink>()), before_(spdlog::default_logger()) {
  auto logger = std::make_shared<spdlog::logger>("test", sink_);
  logger->set_pattern("%l %v");
  spdlog::set_default_logger(std::move(logger));
}

CapturedLog::~CapturedLog() { spdlog::set_default_logger(before_); }

std::vector<std::string> CapturedLog::lines(const std::string& text) const {
  return sink_->lines(text);
}

void CapturedLog::wait_for(const std::string& text, std::size_t times) const {
  sink_->wait_for(text, times);
}

}  // namespace orbbuf::test

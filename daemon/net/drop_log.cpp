// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/drop_log.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cerrno>
#include <iterator>
#include <utility>

#include "common/error.hpp"

namespace orbbuf {

DropLog::DropLog(std::filesystem::path file) : path_(std::move(file)) {
  if (path_.empty()) return;
  file_.open(path_, std::ios::trunc);
  if (!(file_ << kDropCsvHeader << std::endl)) {
    throw_system_error("cannot write the drop log " + path_.string());
  }
}

void DropLog::add(std::span<const DropRecord> records) {
  records_.push(records);
  if (records.empty() || !file_.is_open()) return;
  for (const DropRecord& record : records) file_ << to_csv(record) << '\n';
  if (!file_.flush()) {
    spdlog::error("{}; the robot's own drop log ends here",
                  system_error("cannot write the drop log " + path_.string(), errno).text);
    file_.close();
  }
}

void DropLog::rewind(std::uint64_t next_drop) {
  sent_ = 0;
  acknowledge(next_drop);
}

void DropLog::acknowledge(std::uint64_t next_drop) {
  if (next_drop <= first_) return;
  const auto count = std::min(next_drop - first_, records_.size());
  records_.pop(count);
  first_ += count;
  sent_ -= static_cast<std::size_t>(std::min<std::uint64_t>(sent_, count));
}

wire::Dropped DropLog::take_unsent() {
  const auto& records = records_.oldest();
  const std::size_t count = std::min(records.size() - sent_, wire::kMaxDropsPerMessage);
  const auto begin = std::next(records.begin(), static_cast<std::ptrdiff_t>(sent_));
  wire::Dropped message{first_ + sent_,
                        {begin, std::next(begin, static_cast<std::ptrdiff_t>(count))}};
  sent_ += count;
  return message;
}

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#include "testing/simulation/disk.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <utility>

namespace orbbuf::simulation {

std::string world_folder;

namespace {

constexpr std::size_t kPage = 4096;
constexpr std::size_t kSector = 512;

std::uint64_t padded(std::uint64_t bytes) { return (bytes + 7) / 8 * 8; }

}  // namespace

std::string folder_name(int number) { return fmt::format("machine{}", number); }

void log_operation(DiskOperation operation, std::uint64_t inode, std::uint64_t value,
                   std::string_view name, std::string_view other, std::string_view data) {
  const int number = my_machine_number();
  Disk& disk = my_machine().disk;
  DiskEntry entry;
  entry.operation = operation;
  entry.number = ++disk.operations;
  entry.inode = inode;
  entry.value = value;
  entry.name_bytes = static_cast<std::uint32_t>(name.size());
  entry.other_bytes = static_cast<std::uint32_t>(other.size());
  entry.data_bytes = static_cast<std::uint32_t>(data.size());
  const std::uint64_t needed = padded(sizeof entry + name.size() + other.size() + data.size());
  while (disk.log_used + needed > kDiskLogBytes / 2) {  // the controller takes it first
    call_controller();
    pass_turn();
  }
  char* to = disk_logs[static_cast<std::size_t>(number)] + disk.log_used;
  std::memcpy(to, &entry, sizeof entry);
  to += sizeof entry;
  for (const std::string_view part : {name, other, data}) {
    std::memcpy(to, part.data(), part.size());
    to += part.size();
  }
  disk.log_used += needed;
}

void Device::follow() {
  Disk& disk = machine(machine_).disk;
  const char* const log = disk_logs[static_cast<std::size_t>(machine_)];
  for (std::uint64_t at = 0; at < disk.log_used;) {
    DiskEntry entry;
    std::memcpy(&entry, log + at, sizeof entry);
    const char* from = log + at + sizeof entry;
    Change change;
    change.operation = entry.operation;
    change.number = entry.number;
    change.inode = entry.inode;
    change.value = entry.value;
    change.name.assign(from, entry.name_bytes);
    change.other.assign(from + entry.name_bytes, entry.other_bytes);
    change.data.assign(from + entry.name_bytes + entry.other_bytes, entry.data_bytes);
    take(std::move(change));
    at += padded(sizeof entry + entry.name_bytes + entry.other_bytes + entry.data_bytes);
  }
  disk.log_used = 0;
}

void Device::take(Change change) {
  switch (change.operation) {
    case DiskOperation::kWrite:
    case DiskOperation::kTruncate:
      dirty_.insert(change.inode);
      files_[change.inode].pending.push_back(std::move(change));
      return;
    case DiskOperation::kSync:
      return sync(change.inode, change.value, false);
    case DiskOperation::kSyncFailed:
      return sync(change.inode, change.value, true);
    default:
      pending_names_.push_back(std::move(change));
  }
}

void Device::sync(std::uint64_t inode, std::uint64_t before, bool has_failed) {
  if (inode == 0) {
    const std::set<std::uint64_t> all = dirty_;
    for (const std::uint64_t one : all) sync_file(one, before, has_failed);
  } else {
    sync_file(inode, before, has_failed);
  }
  if (has_failed) return;
  const auto behind =
      std::find_if(pending_names_.begin(), pending_names_.end(),
                   [before](const Change& change) { return change.number >= before; });
  for (auto one = pending_names_.begin(); one != behind; ++one) apply_name(*one);
  pending_names_.erase(pending_names_.begin(), behind);
}

void Device::sync_file(std::uint64_t inode, std::uint64_t before, bool has_failed) {
  const auto found = files_.find(inode);
  if (found == files_.end()) return;
  auto& pending = found->second.pending;
  const auto behind = std::find_if(pending.begin(), pending.end(), [before](const Change& change) {
    return change.number >= before;
  });
  if (!has_failed) {
    for (auto one = pending.begin(); one != behind; ++one) apply(*one, found->second.durable);
  }
  pending.erase(pending.begin(), behind);
  if (pending.empty()) dirty_.erase(inode);
}

void Device::apply_name(const Change& change) {
  switch (change.operation) {
    case DiskOperation::kCreate:
    case DiskOperation::kMakeFolder:
      return give_name(change.name, change.inode);
    case DiskOperation::kRemove:
      return take_name(change.name);
    case DiskOperation::kLink: {
      const auto found = names_.find(change.name);
      if (found != names_.end()) give_name(change.other, found->second);
      return;
    }
    case DiskOperation::kRename: {
      std::vector<std::pair<std::string, std::uint64_t>> moved;
      const std::string below = change.name + "/";
      if (const auto found = names_.find(change.name); found != names_.end()) {
        moved.emplace_back(change.other, found->second);
      }
      for (auto at = names_.lower_bound(below); at != names_.end(); ++at) {
        if (!at->first.starts_with(below)) break;
        moved.emplace_back(change.other + "/" + at->first.substr(below.size()), at->second);
      }
      for (const auto& [name, inode] : moved) give_name(name, inode);
      for (const auto& [name, inode] : moved) {
        take_name(change.name + name.substr(change.other.size()));
      }
      return;
    }
    default:
      return;
  }
}

void Device::give_name(const std::string& name, std::uint64_t inode) {
  take_name(name);
  names_[name] = inode;
  if (inode != 0) ++links_[inode];
}

void Device::take_name(const std::string& name) {
  const auto found = names_.find(name);
  if (found == names_.end()) return;
  const std::uint64_t inode = found->second;
  names_.erase(found);
  if (inode == 0 || --links_[inode] > 0) return;
  links_.erase(inode);
  files_.erase(inode);
  dirty_.erase(inode);
}

void Device::apply(const Change& change, std::string& content) {
  if (change.operation == DiskOperation::kTruncate) return content.resize(change.value);
  if (content.size() < change.value + change.data.size()) {
    content.resize(change.value + change.data.size());
  }
  content.replace(change.value, change.data.size(), change.data);
}

void Device::apply_by_chance(const Change& change, std::string& content, Random& random) {
  if (change.operation == DiskOperation::kTruncate) return apply(change, content);
  for (std::size_t at = 0; at < change.data.size();) {
    const std::size_t in_page = (change.value + at) % kPage;
    std::size_t piece = std::min(change.data.size() - at, kPage - in_page);
    const std::size_t next = at + piece;
    if (random.one_in(8)) piece = std::min(piece, random.below(kPage / kSector) * kSector);  // torn
    if (!random.one_in(3) && piece > 0) {
      Change part = change;
      part.value += at;
      part.data = change.data.substr(at, piece);
      apply(part, content);
    }
    at = next;
  }
}

void Device::cut_power(Random& random) {
  follow();
  const std::uint64_t kept = random.below(pending_names_.size() + 1);
  for (std::uint64_t i = 0; i < kept; ++i) apply_name(pending_names_[i]);
  pending_names_.clear();
  const std::uint64_t luck = random.below(3);
  for (auto& [inode, file] : files_) {
    for (const Change& change : file.pending) {
      if (luck == 1) apply(change, file.durable);  // all of it had got there
      if (luck == 2) apply_by_chance(change, file.durable, random);
    }
    file.pending.clear();
  }
  write_out();
}

void Device::write_out() {
  namespace fs = std::filesystem;
  const fs::path root = fs::path(world_folder) / folder_name(machine_);
  fs::remove_all(root);
  fs::create_directories(root);
  std::map<std::uint64_t, File> files;
  for (auto& [name, inode] : names_) {  // a folder comes before what is in it
    const fs::path path = root / name;
    if (inode == 0) {
      fs::create_directories(path);
      continue;
    }
    if (!fs::exists(path.parent_path())) fs::create_directories(path.parent_path());
    const std::string& content = files_[inode].durable;
    std::ofstream(path, std::ios::binary)
        .write(content.data(), static_cast<std::streamsize>(content.size()));
    struct stat status {};  // a second name is a copy now; no program of ours minds
    ::stat(path.c_str(), &status);
    files[status.st_ino].durable = content;
    inode = status.st_ino;
  }
  files_ = std::move(files);
  dirty_.clear();
  links_.clear();
  for (const auto& [name, inode] : names_) {
    if (inode != 0) ++links_[inode];
  }
  machine(machine_).disk.used = bytes_below(root);
}

std::uint64_t bytes_below(const std::filesystem::path& folder) {
  std::uint64_t bytes = 0;
  std::error_code absent;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder, absent)) {
    if (entry.is_regular_file(absent)) bytes += entry.file_size(absent);
  }
  return bytes;
}

}  // namespace orbbuf::simulation

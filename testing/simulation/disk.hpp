// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "testing/simulation/world.hpp"

/// The disks of machines. Their files are real, below a folder for each machine in memory: that is
/// what the machine's kernel has. What a power cut leaves is in the machine's log, which says what
/// was done to the files, and what was synced.
namespace orbbuf::simulation {

/// The folder of the world, absolute; each machine has a folder in it.
extern std::string world_folder;
std::string folder_name(int machine);

enum class DiskOperation : std::uint32_t {
  kCreate,
  kMakeFolder,
  kRename,
  kRemove,
  kLink,
  kWrite,
  kTruncate,
  kSync,  ///< inode 0: everything; value: what was done before that operation is on the device
  kSyncFailed,  ///< likewise, and it will never be
};

struct DiskEntry {
  DiskOperation operation = DiskOperation::kCreate;
  std::uint32_t name_bytes = 0;
  std::uint32_t other_bytes = 0;
  std::uint32_t data_bytes = 0;
  std::uint64_t number = 0;  ///< of the operation
  std::uint64_t inode = 0;
  std::uint64_t value = 0;  ///< an offset, a size
};

/// By the calling machine.
void log_operation(DiskOperation operation, std::uint64_t inode, std::uint64_t value,
                   std::string_view name = {}, std::string_view other = {},
                   std::string_view data = {});

/// What is on the device, as the controller knows it. It follows file systems with a journal such
/// as ext4 and XFS: names change in the order in which the program changed them, and a sync of
/// anything brings all changes of names before it to the device; the bytes of a file get there by
/// its own sync, or by chance, in pieces.
class Device {
 public:
  explicit Device(int machine) : machine_(machine) {}

  /// Takes what is in the machine's log.
  void follow();
  /// The machine is off: its folder becomes what a device may have kept.
  void cut_power(Random& random);

 private:
  struct Change {
    DiskOperation operation{};
    std::uint64_t number = 0, inode = 0, value = 0;
    std::string name, other, data;
  };
  struct File {
    std::string durable;
    std::vector<Change> pending;
  };

  void take(Change change);
  void sync(std::uint64_t inode, std::uint64_t before, bool has_failed);
  void sync_file(std::uint64_t inode, std::uint64_t before, bool has_failed);
  void apply_name(const Change& change);
  void give_name(const std::string& name, std::uint64_t inode);
  void take_name(const std::string& name);
  static void apply(const Change& change, std::string& content);
  static void apply_by_chance(const Change& change, std::string& content, Random& random);
  void write_out();

  const int machine_;
  std::map<std::string, std::uint64_t> names_;  ///< on the device; 0: a folder
  std::vector<Change> pending_names_;
  std::map<std::uint64_t, int> links_;
  std::map<std::uint64_t, File> files_;
  std::set<std::uint64_t> dirty_;  ///< with pending changes
};

/// The bytes of all files of a machine.
std::uint64_t bytes_below(const std::filesystem::path& folder);

}  // namespace orbbuf::simulation

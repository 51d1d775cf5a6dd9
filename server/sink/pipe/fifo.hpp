// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "server/sink/pipe/pipe_reader.hpp"

namespace orbbuf {

/// A FIFO that some program opens for reading when it likes.
///
/// The FIFO is made if it is missing, with its folders, and stays. One session writes at a time:
/// another one with the same path finds no reader until the first has closed it. Nor does it while
/// there is something left in the FIFO, which a session or a server that has ended may have broken
/// off in the middle of a frame: the reader sees that end before the new beginning. A program that
/// opens the FIFO while its predecessor is still reading takes over in the middle of a frame; one
/// that comes after it has gone begins with a frame.
class Fifo final : public PipeReader {
 public:
  explicit Fifo(std::filesystem::path path);

  /// An error if the path is something else than a FIFO, which is then left alone.
  Result<UniqueFd> connect(std::function<void()> gone) override;
  std::string name() const override { return path_.string(); }

 private:
  std::filesystem::path path_;
};

}  // namespace orbbuf

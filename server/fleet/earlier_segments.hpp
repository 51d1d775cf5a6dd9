// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "server/fleet/fetch_segment.hpp"
#include "server/fleet/key_store.hpp"
#include "server/fleet/page_client.hpp"
#include "server/session/earlier_frames.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf::fleet {

/// The frames of a session's segments before this server's, of each those up to where the next one
/// begins. Those of other servers come from their pages, image by image. Nothing is asked before
/// the first frame is.
///
/// A server that does not answer is tried again for kPatience, as it may be one that is being
/// started again; then its frames are passed over, with one warning.
///
/// Memory: times.txt of the segment that is read, and a frame. Files here are read in `files`.
class EarlierSegments final : public EarlierFrames,
                              public std::enable_shared_from_this<EarlierSegments> {
 public:
  static constexpr std::chrono::seconds kPatience{5};
  static constexpr std::chrono::milliseconds kRetry{500};

  /// Which segments, and whose are here.
  struct Options {
    SessionName session;
    std::uint64_t epoch = 0;      ///< those of smaller ones
    std::string server;           ///< this one
    std::filesystem::path files;  ///< its files.path
    std::chrono::milliseconds patience{kPatience};
  };

  /// All must outlive every run of `main`.
  EarlierSegments(boost::asio::io_context& main, boost::asio::thread_pool& files, KeyStore& store,
                  Options options);

  void async_next(Sequence first, Done done) override;
  void close() override;

 private:
  using Clock = std::chrono::steady_clock;

  struct Part {
    Segment segment;
    Sequence end = 0;  // where the next one begins
    std::string http;  // empty: its server does not live, or has no page
    bool is_given_up = false;
  };
  /// What is being read.
  struct Source {
    std::size_t part = 0;
    std::shared_ptr<FrameFollower> local;  // or
    std::shared_ptr<PageClient> client;    // of the server's page
    std::string path;                      // on that page, of the folder
    std::optional<std::string> times;      // times.txt
    std::size_t offset = 0;                // in it, where the next line begins
    std::optional<bool> is_stereo;         // as its first frame is
    bool has_warned = false;               // of an image that is not there
  };

  void find();
  void on_found(const std::vector<FoundSegment>& found);
  void step();
  std::vector<Part>::iterator next_part();
  void open(std::size_t part);
  void read_local();
  void on_local(Result<FramePtr> frame);
  void fetch_times();
  void fetch_next();
  void on_left(Sequence sequence, std::int64_t time_ns, std::optional<std::string> left);
  void fetch_right(EncodedFrame frame);
  void pass_over(Sequence sequence, const std::string& image);
  void on_part_over();
  void on_failed(const std::string& why);
  void give_up(const std::string& why);
  void finish(FramePtr frame);
  template <class Use>
  void get(const std::string& file, Use use);

  boost::asio::io_context& main_;
  boost::asio::thread_pool& files_;
  KeyStore& store_;
  const Options options_;
  boost::asio::steady_timer retry_;
  bool is_closed_ = false;
  std::optional<std::vector<Part>> parts_;  // nothing: not found yet
  std::optional<Source> source_;
  std::optional<Clock::time_point> failing_since_;
  Sequence first_ = 0;  // of the outstanding call, moved on where nothing is left
  Done done_;
};

}  // namespace orbbuf::fleet

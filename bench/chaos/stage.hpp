// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "bench/chaos/check.hpp"
#include "bench/chaos/plan.hpp"
#include "bench/power_disk.hpp"
#include "testing/certificates.hpp"
#include "testing/namespaces.hpp"
#include "testing/process.hpp"

namespace orbbuf::chaos {

/// Where the real programs are.
struct Programs {
  std::filesystem::path robot;
  std::filesystem::path server;
};

/// How the robots reach the server, and what they keep.
struct LinkKind {
  int links = 1;           ///< or 2: then cuts take the first, the second and both in turn
  bool has_tls = false;    ///< with keys made for the purpose
  bool has_spool = false;  ///< a folder for each robot, which its sessions share
  /// Each second robot that is killed loses power instead: its disk has what was synced.
  bool has_power_cuts = false;
};

/// A server and a robot for each congestion control, in two network namespaces, and all that can
/// happen to them. What they leave behind lies in `work`.
class Stage {
 public:
  /// The rate of `kRate` is the first link's. Throws std::runtime_error if it cannot be set.
  Stage(Programs programs, std::filesystem::path work, const std::vector<std::string>& controls,
        LinkKind kind);

  /// The congestion controls of `wanted` that this kernel has for connections of network
  /// namespaces; empty without namespaces, `why` then says what failed.
  static std::vector<std::string> available(const std::vector<std::string>& wanted,
                                            std::string& why);

  /// Server and robots, each robot with a policy and a capacity of its own.
  void begin();
  void apply(const Step& step);
  /// All robots and the server end in peace; with spools, each robot has sent what it kept before.
  /// Throws std::runtime_error if one does not.
  void end();

  const std::vector<Session>& sessions() const { return sessions_; }
  std::filesystem::path source() const { return work_ / "source"; }

 private:
  struct Robot {
    std::string id;
    std::string address;
    std::unique_ptr<test::Process> process;
    std::size_t session;                     ///< in sessions_
    std::unique_ptr<bench::PowerDisk> disk;  ///< null: it has none of its own
  };

  static constexpr double kFps = 40;

  void make_source();
  void make_keys();
  void cut();
  void mend();
  void on_robot(const std::vector<std::string>& command) const;
  void on_server(const std::vector<std::string>& command) const;
  void start_server();
  void start_robot(Robot& robot, double fps = kFps);
  void kill(Robot& robot);
  void end_robots();
  void send_spools();
  /// It has ended, or is killed: keeps what it printed, and names its session.
  void bury_robot(Robot& robot, bool was_killed);
  void stop_server(int signal);

  const Programs programs_;
  const std::filesystem::path work_;
  const int links_;
  const bool has_spool_;
  std::unique_ptr<test::Certificates> keys_;  // null: plain TCP
  test::Namespaces hosts_;
  int cuts_ = 0;
  std::vector<std::string> cut_links_;
  std::string port_ = "0";
  std::unique_ptr<test::Process> server_;
  std::vector<Robot> robots_;
  std::vector<Session> sessions_;
  int servers_ = 0;
  int kills_ = 0;
};

}  // namespace orbbuf::chaos

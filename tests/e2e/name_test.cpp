// SPDX-License-Identifier: Apache-2.0
// A server that is known by its name, to a robot's host whose name server and table of hosts the
// test writes.
#include <gtest/gtest.h>

#include <csignal>

#include "testing/namespaces.hpp"
#include "tests/e2e/rig.hpp"

namespace orbbuf::test {
namespace {

constexpr const char* kNowhere = "10.77.0.9";  // on the network, but no host has it

class NameTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!hosts_.exist()) GTEST_SKIP() << hosts_.why();
    // A name server behind the dead link, which the resolver asks for minutes.
    write_file(folder_ / "resolv.conf", "nameserver 10.77.0.2\noptions timeout:30 attempts:5\n");
    write_file(folder_ / "nsswitch.conf", "hosts: files dns\n");
    set_addresses({});
  }
  /// What the name `slam` means from now on, by the robot's table of hosts.
  void set_addresses(const std::vector<std::string>& addresses) {
    std::string table;
    for (const std::string& address : addresses) table += address + " slam\n";
    write_file(folder_ / "hosts", table);
  }
  std::unique_ptr<Process> robot(const std::string& port, Overrides overrides) const {
    std::string mounts;
    for (const char* file : {"resolv.conf", "nsswitch.conf", "hosts"}) {
      mounts += "mount --bind " + (folder_ / file).string() + " /etc/" + file + " && ";
    }
    std::vector<std::string> where = {"unshare", "--mount", "sh", "-c", mounts + "exec \"$@\"",
                                      "sh"};
    const auto on_robot = hosts_.on_robot();
    where.insert(where.end(), on_robot.begin(), on_robot.end());
    for (const char* one :
         {"source.frames=1000000", "source.width=160", "source.height=120", "log.level=debug"}) {
      overrides.emplace_back(one);
    }
    return std::make_unique<Process>(robot_command(kRobot, "slam:" + port, overrides, where));
  }

  const Namespaces hosts_;
  const TemporaryFolder folder_;
};

TEST_F(NameTest, ASignalEndsTheRobotInTheMiddleOfALookup) {
  hosts_.cut_link();
  const auto robot = this->robot("7722", {"link.connect_timeout=1 s", "link.drain_timeout=0 s"});
  ASSERT_TRUE(robot->wait_for_line("cannot resolve slam: no answer")) << robot->output();
  robot->signal(SIGTERM);
  EXPECT_EQ(robot->wait(std::chrono::seconds(20)), 3) << robot->output();  // a lookup takes minutes
}

TEST_F(NameTest, TheLinkIsUsedWhileALookupIsUnanswered) {
  Server server(folder_ / "out", {"listen.insecure=true"}, Namespaces::kServerListen,
                hosts_.on_server());
  hosts_.cut_link();
  const std::string port = server.address().substr(server.address().rfind(':') + 1);
  const auto robot = this->robot(port, {});
  ASSERT_TRUE(robot->wait_for_lines("] captured ", 2)) << robot->output();
  set_addresses({kNowhere, "10.77.0.2"});  // the next lookup finds them, whatever the first does
  hosts_.mend_link();
  EXPECT_TRUE(robot->wait_for_line("connected to")) << robot->output();
  robot->signal(SIGTERM);
  ASSERT_EQ(robot->wait(), 0) << robot->output();
  expect_exactly_once(read_record(folder_ / "out", kRobot), closing_stats(*robot).at("captured"));
}

TEST_F(NameTest, AServerThatHasMovedIsFoundWhereTheNameSays) {
  Server server(folder_ / "out", {"listen.insecure=true"}, Namespaces::kServerListen,
                hosts_.on_server());
  set_addresses({kNowhere});
  const std::string port = server.address().substr(server.address().rfind(':') + 1);
  const auto robot = this->robot(port, {"link.drain_timeout=0 s"});
  ASSERT_TRUE(robot->wait_for_line("no connection to slam")) << robot->output();
  set_addresses({"10.77.0.2"});
  EXPECT_TRUE(robot->wait_for_line("connected to")) << robot->output();
}

TEST_F(NameTest, AServerOfBothFamiliesIsReachedOverTheOneThatWorks) {
  Server server(folder_ / "out", {"listen.insecure=true"}, Namespaces::kServerListen,
                hosts_.on_server());
  auto add_address = hosts_.on_robot();
  for (const char* word : {"ip", "addr", "add", "fd77::1/64", "dev", Namespaces::kLink, "nodad"}) {
    add_address.emplace_back(word);
  }
  const Finished done = run(add_address);
  if (done.status != 0) GTEST_SKIP() << "no IPv6 here: " << done.output;
  set_addresses({"fd77::9", "10.77.0.2"});  // no host has the first
  const std::string port = server.address().substr(server.address().rfind(':') + 1);
  const auto robot = this->robot(port, {"link.drain_timeout=0 s"});
  EXPECT_TRUE(robot->wait_for_line("connected to")) << robot->output();
}

/// The server's host has the name `slam.local` by multicast DNS: avahi-daemon on both hosts, each
/// with a /run of its own, and the robot's nss-mdns.
class MdnsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!hosts_.exist()) GTEST_SKIP() << hosts_.why();
    if (run({"sh", "-c", "command -v avahi-daemon"}).status != 0) GTEST_SKIP() << kPackages;
    write_file(folder_ / "nsswitch.conf", "hosts: files mdns4_minimal [NOTFOUND=return]\n");
    servers_names_ = publish("slam", hosts_.on_server());
    robots_names_ = publish("robot", hosts_.on_robot());
    const auto found =
        run(with_run("robot", hosts_.on_robot(), {"getent", "ahostsv4", "slam.local"}));
    if (found.status != 0) GTEST_SKIP() << kPackages;
  }
  std::unique_ptr<Process> publish(const std::string& name,
                                   const std::vector<std::string>& host) const {
    std::filesystem::create_directories(folder_ / name / "avahi-daemon");
    const auto settings = folder_ / (name + ".conf");
    write_file(settings, "[server]\nhost-name=" + name +
                             "\nuse-ipv6=no\nenable-dbus=no\nallow-interfaces=" +
                             Namespaces::kLink + "\n[publish]\npublish-workstation=no\n");
    auto daemon =
        std::make_unique<Process>(with_run(name, host,
                                           {"avahi-daemon", "--no-drop-root", "--no-chroot",
                                            "--no-rlimits", "--file", settings.string()}));
    EXPECT_TRUE(daemon->wait_for_line("Server startup complete")) << daemon->output();
    return daemon;
  }
  /// `command` on `host`, where /run is the folder `name`, and nss-mdns is in use.
  std::vector<std::string> with_run(const std::string& name, std::vector<std::string> host,
                                    const std::vector<std::string>& command) const {
    const std::string mounts = "mount --bind " + (folder_ / name).string() +
                               " /run && mount --bind " + (folder_ / "nsswitch.conf").string() +
                               " /etc/nsswitch.conf && exec \"$@\"";
    host.insert(host.end(), {"unshare", "--mount", "sh", "-c", mounts, "sh"});
    host.insert(host.end(), command.begin(), command.end());
    return host;
  }

  static constexpr const char* kPackages =
      "no names of multicast DNS here (Debian: avahi-daemon libnss-mdns)";
  const Namespaces hosts_;
  const TemporaryFolder folder_;
  std::unique_ptr<Process> servers_names_;
  std::unique_ptr<Process> robots_names_;
};

TEST_F(MdnsTest, AServerIsFoundByItsLocalNameAndAgainAtItsNextAddress) {
  Server server(folder_ / "out", {"listen.insecure=true"}, "0.0.0.0:0", hosts_.on_server());
  const std::string port = server.address().substr(server.address().rfind(':') + 1);
  Process robot(robot_command(kRobot, "slam.local:" + port,
                              {"source.frames=1000000", "source.width=160", "source.height=120"},
                              with_run("robot", hosts_.on_robot(), {})));
  ASSERT_TRUE(robot.wait_for_line("connected to slam.local")) << robot.output();
  for (const char* step :
       {"ip addr del 10.77.0.2/24 dev wire", "ip addr add 10.77.0.7/24 dev wire"}) {
    auto command = hosts_.on_server();
    command.insert(command.end(), {"sh", "-c", step});
    ASSERT_EQ(run(command).status, 0) << step;
  }
  ASSERT_TRUE(robot.wait_for_lines("connected to slam.local", 2)) << robot.output();
  robot.signal(SIGTERM);
  ASSERT_EQ(robot.wait(), 0) << robot.output();
  expect_exactly_once(read_record(folder_ / "out", kRobot), closing_stats(robot).at("captured"));
}

}  // namespace
}  // namespace orbbuf::test

// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/bind_interface.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <linux/capability.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <thread>

namespace orbbuf {
namespace {

class BindInterfaceTest : public testing::Test {
 protected:
  ~BindInterfaceTest() override { ::close(socket_); }

  std::string bind_to(const std::string& interface, int family = AF_INET) const {
    const auto failed = bind_interface(socket_, family, interface);
    return failed ? failed->text : "";
  }
  std::string device() const {
    std::array<char, IFNAMSIZ> name{};
    socklen_t size = name.size();
    EXPECT_EQ(::getsockopt(socket_, SOL_SOCKET, SO_BINDTODEVICE, name.data(), &size), 0);
    return {name.data()};
  }
  std::string source() const {
    sockaddr_in address{};
    socklen_t size = sizeof address;
    EXPECT_EQ(::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size), 0);
    std::array<char, INET_ADDRSTRLEN> text{};
    return ::inet_ntop(AF_INET, &address.sin_addr, text.data(), text.size());
  }

  const int socket_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
};

TEST_F(BindInterfaceTest, ANameIsTheInterfaceWhateverTheSource) {
  EXPECT_EQ(bind_to("lo"), "");
  EXPECT_EQ(device(), "lo");
  EXPECT_EQ(source(), "0.0.0.0");
}

TEST_F(BindInterfaceTest, AnAddressIsTheSourceWhateverTheInterface) {
  EXPECT_EQ(bind_to("127.0.0.9"), "");
  EXPECT_EQ(device(), "");
  EXPECT_EQ(source(), "127.0.0.9");
}

TEST_F(BindInterfaceTest, TheErrorNamesWhatCannotBeUsedAndWhy) {
  EXPECT_EQ(bind_to("gone0"), "cannot use interface gone0: No such device");
  EXPECT_EQ(bind_to("192.0.2.1"),
            "cannot use source address 192.0.2.1: Cannot assign requested address");
  EXPECT_EQ(bind_to("::1"),
            "cannot use source address ::1: the server's address is of the other IP version");
}

// Linux wants CAP_NET_RAW for a socket that is bound already; before 5.7, for each.
TEST_F(BindInterfaceTest, WithoutThePrivilegeTheInterfacesAddressIsTheSource) {
  ASSERT_EQ(bind_to("lo"), "");
  std::string outcome;
  std::thread([&] {
    __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
    std::array<__user_cap_data_struct, 2> none{};
    ASSERT_EQ(::syscall(SYS_capset, &header, none.data()), 0);
    outcome = bind_to("lo");
  }).join();
  EXPECT_EQ(outcome, "");
  EXPECT_EQ(source(), "127.0.0.1");
}

}  // namespace
}  // namespace orbbuf

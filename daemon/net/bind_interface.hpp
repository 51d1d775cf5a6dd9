// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "common/error.hpp"

namespace orbbuf {

/// Has a socket that is not connected yet use one network interface. Reentrant.
///
/// family: the socket's, AF_INET or AF_INET6. interface: its name, or an address of this host as
/// the source. By name the kernel sends and receives over that interface only (SO_BINDTODEVICE);
/// where it needs a privilege for that (before Linux 5.7), the interface's first address becomes
/// the source, and the routes decide. Returns why it failed.
std::optional<Error> bind_interface(int socket, int family, const std::string& interface);

}  // namespace orbbuf

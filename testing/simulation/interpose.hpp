// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>
#include <sys/uio.h>

#include <cstddef>

/// What interpose_files.cpp needs of interpose_network.cpp.
namespace orbbuf::simulation {

bool is_simulated(int fd);
ssize_t simulated_input(int fd, const iovec* parts, std::size_t count, int flags);
ssize_t simulated_output(int fd, const iovec* parts, std::size_t count, int flags);
/// Before the number is free again.
void forget_descriptor(int fd);

}  // namespace orbbuf::simulation

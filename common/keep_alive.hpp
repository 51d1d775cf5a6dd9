// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace orbbuf {

/// Has the kernel end a TCP connection that is idle and whose peer has been silent for about 15 s:
/// gone without a word, as a host does that loses its power. False if the system refuses.
bool keep_alive(int socket);

}  // namespace orbbuf

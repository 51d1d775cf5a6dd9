// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace orbbuf {

/// Sets TCP keep-alive: the kernel closes the connection when its peer has not answered for about
/// 15 s, for example because its host lost power. False if the system refuses.
bool keep_alive(int socket);

}  // namespace orbbuf

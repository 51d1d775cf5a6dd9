// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace orbbuf::test {

// What the tests start, as paths: the programs, or scripts that have the emulator run them. They
// are in one object file, so that a compiler's cache serves builds in other folders. The last three
// are null in a build without benches.
extern const char* const kOrbbufd;
extern const char* const kOrbbufServer;
extern const char* const kOrbbufFollow;
extern const char* const kOrbbufChaos;
extern const char* const kOrbbufLinkPeer;
extern const char* const kOrbbufPowercut;

extern const char* const kBuildFolder;

}  // namespace orbbuf::test

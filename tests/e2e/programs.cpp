// SPDX-License-Identifier: Apache-2.0
#include "tests/e2e/programs.hpp"

namespace orbbuf::test {

const char* const kOrbbufd = ORBBUFD;
const char* const kOrbbufServer = ORBBUF_SERVER;
const char* const kOrbbufFollow = ORBBUF_FOLLOW;
#ifdef ORBBUF_CHAOS
const char* const kOrbbufChaos = ORBBUF_CHAOS;
const char* const kOrbbufLinkPeer = ORBBUF_LINK_PEER;
const char* const kOrbbufPowercut = ORBBUF_POWERCUT;
#endif
const char* const kBuildFolder = ORBBUF_BUILD_FOLDER;

}  // namespace orbbuf::test

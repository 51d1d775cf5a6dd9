// SPDX-License-Identifier: Apache-2.0
// Any bytes as a configuration file of the server: read, or refused with a ConfigError of one line.
#include <sys/mman.h>
#include <unistd.h>

#include <cstdlib>
#include <string>

#include "common/unique_fd.hpp"
#include "server/settings.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const orbbuf::UniqueFd file(::memfd_create("config", 0));
  if (::write(file.get(), data, size) != static_cast<ssize_t>(size)) std::abort();
  const std::string path = "/proc/self/fd/" + std::to_string(file.get());
  try {
    orbbuf::ConfigReader reader(path, {});
    orbbuf::load_settings(reader);
  } catch (const orbbuf::ConfigError& error) {
    if (std::string(error.what()).find('\n') != std::string::npos) std::abort();
  }
  return 0;
}

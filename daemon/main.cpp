// SPDX-License-Identifier: Apache-2.0

#include <cstdlib>
#include <iostream>

#include "common/command_line.hpp"
#include "common/log.hpp"
#include "common/net/tls.hpp"
#include "daemon/capture/list_cameras.hpp"
#include "daemon/probe.hpp"
#include "daemon/robot.hpp"
#include "daemon/samples/iio_device.hpp"
#include "daemon/settings.hpp"

namespace {

constexpr const char* kAbout =
    "Captures frames from a camera, or replays recorded ones, and sends them to orbbuf-server.\n"
    "When the link is too slow for every frame, drops the frames that visual SLAM needs least.\n"
    "config/orbbufd.toml documents every key of the configuration.";

}  // namespace

int main(int argc, char** argv) {
  orbbuf::set_up_log("info");
  orbbuf::CommandLine app(kAbout, "orbbufd");
  std::string file;
  std::vector<std::string> overrides;
  bool check_only = false, list_only = false, list_imus = false, probe_only = false;
  app.add_option("--config", file,
                 "Configuration file (TOML); default: none, every key at its default")
      .value_name("FILE");
  app.add_option("--set", overrides,
                 "Override a configuration value, e.g. link.server=10.0.0.1:7722")
      .value_name("KEY=VALUE")
      .one_by_one();
  app.add_flag("--check-config", check_only, "Check the configuration and exit");
  app.add_flag("--list-cameras", list_only,
               "List the cameras with their formats and controls, and exit");
  app.add_flag("--list-imus", list_imus,
               "List the inertial sensors that are devices of IIO, and exit");
  app.add_flag("--probe", probe_only,
               "Capture for 2 s, report rates and costs, suggest a configuration");
  app.add_version("orbbufd " ORBBUF_VERSION);
  app.add_script("setup", "Ask for server and camera, check both, write the configuration",
                 "Usage: orbbufd setup [OPTIONS] [ROBOT.tar]\n\n"
                 "ROBOT.tar: what `orbbuf-server add-robot` made. Asks for what no option says.\n\n"
                 "Options:\n"
                 "  --server HOST[:PORT]        The server; ROBOT.tar names it, too\n"
                 "  --camera CAMERA             /dev/..., libcamera:ID, or generated\n"
                 "  --folder FOLDER             By default /etc/orbbuf\n"
                 "  --force                     Write it even if something is wrong");
  app.add_script("doctor", "Name what is wrong on this machine, and what to do",
                 "Option:\n"
                 "  --config FILE               By default /etc/orbbuf/orbbufd.toml");

  try {
    if (const auto status = app.parse(argc, argv)) return *status;
    if (list_only) {
      std::cout << orbbuf::list_cameras();
      return EXIT_SUCCESS;
    }
    if (list_imus) {
      std::cout << orbbuf::list_iio_devices();
      return EXIT_SUCCESS;
    }
    const orbbuf::Settings settings = orbbuf::load_settings(file, overrides);
    orbbuf::set_log_level(settings.log_level);
    for (const std::string& warning : settings.warnings) orbbuf::log_warn("{}", warning);
    if (check_only) {
      orbbuf::make_tls_context(settings.link.tls, true);
      std::cout << (file.empty() ? "defaults" : file) << ": OK\n";
      return EXIT_SUCCESS;
    }
    if (probe_only) {
      std::cout << orbbuf::probe(settings) << std::flush;
      if (!file.empty()) orbbuf::run_script("doctor", {"--config", file});
      return EXIT_SUCCESS;
    }
    return orbbuf::run_robot(settings);
  } catch (const std::exception& error) {
    orbbuf::log_error("{}", error.what());
    return EXIT_FAILURE;
  }
}

// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <string>
#include <vector>

#include "common/config.hpp"
#include "common/log.hpp"
#include "server/serve.hpp"
#include "server/settings.hpp"

int main(int argc, char** argv) try {
  CLI::App app("Receives frames from robots and hands them to SLAM programs.", "orbbuf-server");
  std::string config;
  std::vector<std::string> overrides;
  bool is_check = false;
  app.add_option("--config", config, "Configuration file (TOML); without one, the defaults")
      ->type_name("FILE");
  app.add_option("--set", overrides, "Lay a value over the configuration; repeatable")
      ->type_name("TABLE.KEY=VALUE")
      ->allow_extra_args(false);
  app.add_flag("--check-config", is_check, "Check the configuration and exit");
  app.set_version_flag("--version", "orbbuf-server " ORBBUF_VERSION);
  CLI11_PARSE(app, argc, argv);

  orbbuf::set_up_log("info");
  orbbuf::ConfigReader reader(config, overrides);
  const orbbuf::Settings settings = orbbuf::load_settings(reader);
  if (is_check) {
    std::cout << (config.empty() ? "defaults" : config) << ": OK\n";
    return EXIT_SUCCESS;
  }
  spdlog::set_level(spdlog::level::from_str(settings.log_level));
  orbbuf::serve(settings);
  return EXIT_SUCCESS;
} catch (const std::exception& error) {
  spdlog::error("{}", error.what());
  return EXIT_FAILURE;
}

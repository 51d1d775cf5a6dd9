// SPDX-License-Identifier: Apache-2.0
#include "common/command_line.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <system_error>

namespace orbbuf {

CommandLine::Option& CommandLine::Option::required() {
  option_->required();
  return *this;
}

CommandLine::Option& CommandLine::Option::value_name(const std::string& name) {
  option_->type_name(name);
  return *this;
}

CommandLine::Option& CommandLine::Option::one_by_one() {
  option_->allow_extra_args(false);
  return *this;
}

CommandLine::Option& CommandLine::Option::one_of(const std::vector<std::string>& words) {
  option_->check(CLI::IsMember(words).description(""));
  return *this;
}

CommandLine::Option& CommandLine::Option::in_range(double min, double max) {
  option_->check(CLI::Range(min, max).description(""));
  return *this;
}

CommandLine::Option& CommandLine::Option::values(int count) {
  option_->expected(count);
  return *this;
}

CommandLine::Option& CommandLine::Option::needs(const std::string& other) {
  option_->needs(other);
  return *this;
}

CommandLine::Option& CommandLine::Option::with_default() {
  option_->capture_default_str();
  return *this;
}

CommandLine::CommandLine(const std::string& about, const std::string& name)
    : app_(std::make_shared<CLI::App>(about, name)) {}

CommandLine::Option CommandLine::add_option(const std::string& name, Variable value,
                                            const std::string& about) {
  return std::visit([&](auto* at) { return Option(app_->add_option(name, *at, about)); }, value);
}

CommandLine::Option CommandLine::add_flag(const std::string& name, bool& is_given,
                                          const std::string& about) {
  return Option(app_->add_flag(name, is_given, about));
}

CommandLine::Option CommandLine::add_flag(const std::string& name, std::function<void()> when_given,
                                          const std::string& about) {
  return Option(app_->add_flag_callback(name, std::move(when_given), about));
}

void CommandLine::add_version(const std::string& text) {
  app_->set_version_flag("--version", text);
}

CommandLine CommandLine::add_subcommand(const std::string& name, const std::string& about,
                                        std::function<void()> when_given) {
  app_->require_subcommand(0, 1);
  CLI::App* const added = app_->add_subcommand(name, about);
  added->callback(std::move(when_given));
  return CommandLine(std::shared_ptr<CLI::App>(app_, added));
}

void CommandLine::add_script(const std::string& name, const std::string& about,
                             const std::string& usage) {
  app_->require_subcommand(0, 1);
  CLI::App* const added = app_->add_subcommand(name, about);
  added->prefix_command()->footer(usage);
  added->callback([added, name] { run_script(name, added->remaining()); });
}

void run_script(const std::string& name, std::vector<std::string> arguments) {
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe");
  const auto script =
      program.parent_path().parent_path() / "lib" / program.filename() / (name + ".sh");
  arguments.insert(arguments.begin(), {script.string(), program.string()});
  std::vector<char*> pointers;
  pointers.reserve(arguments.size() + 1);
  for (std::string& argument : arguments) pointers.push_back(argument.data());
  pointers.push_back(nullptr);
  // set_up_log() does not wait for the reader of stderr; the script may.
  ::fcntl(STDERR_FILENO, F_SETFL, ::fcntl(STDERR_FILENO, F_GETFL) & ~O_NONBLOCK);
  ::execv(script.c_str(), pointers.data());
  throw std::system_error(errno, std::generic_category(), "cannot run " + script.string());
}

void CommandLine::add_footer(const std::string& text) { app_->footer(text); }

std::optional<int> CommandLine::parse(int argc, char** argv) {
  try {
    app_->parse(argc, argv);
    return std::nullopt;
  } catch (const CLI::ParseError& error) {
    return app_->exit(error);
  }
}

}  // namespace orbbuf

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
class Option;
}  // namespace CLI

namespace orbbuf {

/// The arguments of a program, or of one of its subcommands, read by CLI11. That library is
/// compiled in command_line.cpp alone, since it takes ten seconds a file. Start-up only.
class CommandLine {
 public:
  template <class... Types>
  using Pointers = std::variant<Types*..., std::vector<Types>*...>;
  using Variable = Pointers<std::string, std::filesystem::path, int, unsigned, unsigned long,
                            unsigned long long, double>;

  /// What else is known of an option; each returns the option itself.
  class Option {
   public:
    explicit Option(CLI::Option* option) : option_(option) {}
    Option& required();
    /// What --help shows as its value, e.g. FILE; nothing if it is empty.
    Option& value_name(const std::string& name);
    /// Of a list: one value after each mention of the option.
    Option& one_by_one();
    Option& one_of(const std::vector<std::string>& words);
    Option& in_range(double min, double max);
    /// Of a list: exactly as many values.
    Option& values(int count);
    Option& needs(const std::string& other);
    /// --help shows the value that the variable has now.
    Option& with_default();

   private:
    CLI::Option* option_;
  };

  /// name: of the program, for --help; by default as it was started.
  explicit CommandLine(const std::string& about, const std::string& name = "");

  /// Writes into `value`, which must outlive parse(). name: `--name`, or without the dashes for an
  /// argument that goes by its place. T: one of Variable.
  template <class T>
  Option add_option(const std::string& name, T& value, const std::string& about = "") {
    return add_option(name, Variable(&value), about);
  }
  Option add_flag(const std::string& name, bool& is_given, const std::string& about = "");
  Option add_flag(const std::string& name, std::function<void()> when_given,
                  const std::string& about = "");
  /// Adds --version, which prints `text`.
  void add_version(const std::string& text);
  /// At most one subcommand may be given; parse() then calls `when_given`.
  CommandLine add_subcommand(const std::string& name, const std::string& about,
                             std::function<void()> when_given);
  /// A subcommand that runs the script NAME.sh with the arguments after it. usage: of its --help.
  void add_script(const std::string& name, const std::string& about, const std::string& usage);
  /// The last lines of --help.
  void add_footer(const std::string& text);

  /// The exit status, if the program shall end here: after --help and --version, and when the
  /// arguments are wrong, which it has then said.
  std::optional<int> parse(int argc, char** argv);

 private:
  Option add_option(const std::string& name, Variable value, const std::string& about);
  explicit CommandLine(std::shared_ptr<CLI::App> app) : app_(std::move(app)) {}

  std::shared_ptr<CLI::App> app_;
};

/// Becomes the script ../lib/PROGRAM/NAME.sh, as seen from the folder of this program, whose path
/// is its first argument. Throws std::system_error if it cannot.
[[noreturn]] void run_script(const std::string& name, std::vector<std::string> arguments);

}  // namespace orbbuf

#include "client/cli/command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <ostream>

namespace maneuver::cli {
namespace {

template <typename Number>
CLI::Option* AddNumber(CLI::App* app, const std::string& flags, Number* value, Number least,
                       Number most, const std::string& help) {
  return app->add_option(flags, *value, help)
      ->check(CLI::Range(least, most).description(""))
      ->type_name("NUMBER");
}

template <typename Number>
CLI::Option* AddOptionalNumber(CLI::App* app, const std::string& flags,
                               std::optional<Number>* value, Number least, Number most,
                               const std::string& help) {
  return app
      ->add_option_function<Number>(
          flags, [value](const Number& given) { *value = given; }, help)
      ->check(CLI::Range(least, most).description(""))
      ->type_name("NUMBER");
}

}  // namespace

Command Command::Add(const std::string& name, const std::string& summary, const std::string& help) {
  CLI::App* command = app_->add_subcommand(name, summary);
  command->footer(help.empty() ? "" : "\n" + help);
  app_->require_subcommand(1);
  return Command(command, chosen_);
}

void Command::Argument(const std::string& name, std::string* value, const std::string& help) {
  app_->add_option(name, *value, help)->required();
}

void Command::Argument(const std::string& name, int64_t* value, int64_t least, int64_t most,
                       const std::string& help) {
  AddNumber(app_, name, value, least, most, help)->required();
}

void Command::OptionalArgument(const std::string& name, std::string* value,
                               const std::string& help) {
  app_->add_option(name, *value, help);
}

void Command::Arguments(const std::string& name, std::vector<std::string>* values,
                        const std::string& help) {
  app_->add_option(name, *values, help)->required();
}

void Command::Option(const std::string& flags, std::string* value, const std::string& help,
                     const std::string& environment) {
  CLI::Option* option = app_->add_option(flags, *value, help)->capture_default_str();
  if (!environment.empty()) option->envname(environment);
}

void Command::Option(const std::string& flags, std::optional<std::string>* value,
                     const std::string& help) {
  app_->add_option_function<std::string>(
      flags, [value](const std::string& given) { *value = given; }, help);
}

void Command::Option(const std::string& flags, int64_t* value, int64_t least, int64_t most,
                     const std::string& help) {
  AddNumber(app_, flags, value, least, most, help)->capture_default_str();
}

void Command::Option(const std::string& flags, std::optional<int64_t>* value, int64_t least,
                     int64_t most, const std::string& help) {
  AddOptionalNumber(app_, flags, value, least, most, help);
}

void Command::Option(const std::string& flags, double* value, double least, double most,
                     const std::string& help) {
  AddNumber(app_, flags, value, least, most, help)->capture_default_str();
}

void Command::Option(const std::string& flags, std::optional<double>* value, double least,
                     double most, const std::string& help) {
  AddOptionalNumber(app_, flags, value, least, most, help);
}

void Command::Option(const std::string& flags, std::vector<std::string>* values,
                     const std::string& help, bool required) {
  app_->add_option(flags, *values, help)->required(required);
}

void Command::Option(const std::string& flags, std::vector<int64_t>* values,
                     const std::string& help) {
  app_->add_option(flags, *values, help)->delimiter(',')->type_name("NUMBER");
}

void Command::Choice(const std::string& flags, std::string* value,
                     const std::vector<std::string>& choices, const std::string& help) {
  app_->add_option(flags, *value, help)
      ->check(CLI::IsMember(choices).description(""))
      ->type_name(CLI::detail::join(choices, "|"))
      ->capture_default_str();
}

void Command::Flag(const std::string& flags, bool* value, const std::string& help) {
  app_->add_flag(flags, *value, help);
}

void Command::Exclude(const std::string& flag, const std::string& other) {
  app_->get_option(flag)->excludes(app_->get_option(other));
}

void Command::Need(const std::string& flag, const std::string& other) {
  app_->get_option(flag)->needs(app_->get_option(other));
}

void Command::Run(std::function<int()> run) {
  app_->callback([chosen = chosen_, run = std::move(run)] { *chosen = run; });
}

CommandLine::CommandLine(const std::string& summary, const std::string& name,
                         const std::string& version)
    : app_(std::make_unique<CLI::App>(summary, name)) {
  // Global options may also follow the command that they go with.
  app_->fallthrough();
  app_->set_help_flag("-h,--help", "What this command does and takes");
  app_->set_version_flag("--version", name + " " + version, "Print the version");
  app_->get_formatter()->column_width(36);
  app_->failure_message([](const CLI::App* app, const CLI::Error& error) {
    const auto commands = app->get_subcommands();
    std::string path = app->get_name();
    for (auto used = commands; !used.empty(); used = used.front()->get_subcommands()) {
      path += " " + used.front()->get_name();
    }
    return std::string(error.what()) + "\nTry: " + path + " --help\n";
  });
}

CommandLine::~CommandLine() = default;

Command CommandLine::root() { return Command(app_.get(), &chosen_); }

int CommandLine::Run(std::vector<std::string> arguments, std::ostream& out, std::ostream& err) {
  std::reverse(arguments.begin(), arguments.end());  // as CLI11 takes them
  try {
    app_->parse(std::move(arguments));
  } catch (const CLI::ParseError& error) {
    return app_->exit(error, out, err) == 0 ? kOk : kUsage;
  }
  return chosen_ ? chosen_() : kUsage;
}

}  // namespace maneuver::cli

#include "client/cli/command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <ostream>
#include <type_traits>

namespace maneuver::cli {
namespace {

// CLI::Range accepts "nan", and takes 2^64 for 2^63 - 1.
template <typename Number>
std::string NumberError(const std::string& text) {
  if constexpr (std::is_integral_v<Number>) {
    errno = 0;
    (void)std::strtoll(text.c_str(), nullptr, 0);  // as CLI11 reads it
    return errno == ERANGE ? "Value " + text + " is out of range" : "";
  } else {
    Number number{};
    const bool is_nan = CLI::detail::lexical_cast(text, number) && std::isnan(number);
    return is_nan ? "Value " + text + " is not a number" : "";
  }
}

template <typename Number>
CLI::Option* AddNumber(CLI::App* app, const std::string& flags, Number* value, Number least,
                       Number most, const std::string& help) {
  return app->add_option(flags, *value, help)
      ->check(CLI::Range(least, most).description(""))
      ->check(NumberError<Number>)
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
      ->check(NumberError<Number>)
      ->type_name("NUMBER");
}

std::vector<CLI::App*> CommandsOf(CLI::App* group) {
  return group->get_subcommands([](const CLI::App*) { return true; });
}

// Insertions, deletions and exchanges of letters that turn one word into the other (Levenshtein);
// exchanging two neighbours is one.
size_t EditDistance(const std::string& a, const std::string& b) {
  std::vector<std::vector<size_t>> distance(a.size() + 1, std::vector<size_t>(b.size() + 1));
  for (size_t i = 0; i <= a.size(); ++i) distance[i][0] = i;
  for (size_t j = 0; j <= b.size(); ++j) distance[0][j] = j;
  for (size_t i = 1; i <= a.size(); ++i) {
    for (size_t j = 1; j <= b.size(); ++j) {
      distance[i][j] =
          std::min({distance[i - 1][j] + 1, distance[i][j - 1] + 1,
                    distance[i - 1][j - 1] + (a[i - 1] == b[j - 1] ? size_t{0} : size_t{1})});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        distance[i][j] = std::min(distance[i][j], distance[i - 2][j - 2] + 1);
      }
    }
  }
  return distance[a.size()][b.size()];
}

// "; did you mean train?", empty if no name is within a third of the word's letters.
std::string DidYouMean(const std::string& word, const std::vector<std::string>& names) {
  std::string nearest;
  size_t least = std::max<size_t>(word.size() / 3, 1) + 1;
  for (const std::string& name : names) {
    const size_t distance = EditDistance(word, name);
    if (distance >= least) continue;
    least = distance;
    nearest = name;
  }
  return nearest.empty() ? "" : "; did you mean " + nearest + "?";
}

std::vector<std::string> NamesOf(const std::vector<CLI::App*>& commands) {
  std::vector<std::string> names;
  names.reserve(commands.size());
  for (const CLI::App* command : commands) names.push_back(command->get_name());
  return names;
}

std::vector<std::string> LongOptionsOf(const std::vector<const CLI::App*>& apps) {
  std::vector<std::string> names;
  for (const CLI::App* app : apps) {
    for (const CLI::Option* option : app->get_options()) {
      for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    }
  }
  return names;
}

// Names the word that is not a command, or not an option of the command; empty if there is none.
//   root: has parsed the arguments
//   elsewhere: other programs by the command that they have
std::string UnknownWord(CLI::App* root, const std::map<std::string, std::string>& elsewhere) {
  CLI::App* group = root;
  std::string path = root->get_name();
  while (!group->get_subcommands().empty()) {
    group = group->get_subcommands().front();
    path += " " + group->get_name();
  }
  const bool has_commands = !CommandsOf(group).empty();
  for (const std::string& word : root->remaining(/*recurse=*/true)) {
    if (word.starts_with("--") && word != "--") {
      const std::string option = word.substr(0, word.find('='));
      return path + " has no option " + option + DidYouMean(option, LongOptionsOf({group, root}));
    }
    if (!has_commands || word.starts_with("-")) continue;
    const std::string unknown = path + " has no command " + word;
    if (const auto found = elsewhere.find(word); group == root && found != elsewhere.end()) {
      return unknown + "; " + found->second + " has: " + found->second + " " + word + " --help";
    }
    return unknown + DidYouMean(word, NamesOf(CommandsOf(group)));
  }
  return "";
}

OptionEntry EntryOf(const CLI::Option& option) {
  OptionEntry entry;
  for (const std::string& flag : option.get_snames()) entry.flags.push_back("-" + flag);
  for (const std::string& flag : option.get_lnames()) entry.flags.push_back("--" + flag);
  entry.takes_value = option.get_expected_max() > 0 && option.get_type_size_max() > 0;
  entry.help = option.get_description();
  const std::string type = option.get_type_name();
  if (type.find('|') != std::string::npos) entry.choices = CLI::detail::split(type, '|');
  return entry;
}

CommandEntry EntryOf(CLI::App* app, const std::string& path) {
  CommandEntry entry;
  entry.path = path;
  entry.summary = app->get_description();
  for (const CLI::Option* option : app->get_options()) {
    OptionEntry described = EntryOf(*option);
    if (!described.flags.empty()) entry.options.push_back(std::move(described));
  }
  for (CLI::App* below : CommandsOf(app)) {
    entry.commands.push_back(EntryOf(below, path + " " + below->get_name()));
  }
  return entry;
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

void Command::OptionalArguments(const std::string& name, std::vector<std::string>* values,
                                const std::string& help) {
  app_->add_option(name, *values, help);
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
  app_->add_option(flags, *values, help)->required(required)->allow_extra_args(false);
}

void Command::Option(const std::string& flags, std::vector<int64_t>* values, int64_t least,
                     int64_t most, const std::string& help) {
  app_->add_option(flags, *values, help)
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::Range(least, most).description(""))
      ->check(NumberError<int64_t>)
      ->type_name("NUMBER");
}

void Command::Choice(const std::string& flags, std::string* value,
                     const std::vector<std::string>& choices, const std::string& help) {
  app_->add_option(flags, *value, help)
      ->check(CLI::IsMember(choices).description(""))
      ->type_name(CLI::detail::join(choices, "|"))
      ->capture_default_str();
}

void Command::Choices(const std::string& flags, std::vector<std::string>* values,
                      const std::vector<std::string>& choices, const std::string& help) {
  app_->add_option(flags, *values, help)
      ->allow_extra_args(false)
      ->check(CLI::IsMember(choices).description(""))
      ->type_name(CLI::detail::join(choices, "|"));
}

void Command::Picture(const std::string& flags, std::optional<std::string>* value,
                      const std::string& help) {
  app_->add_option_function<std::string>(
          flags, [value](const std::string& given) { *value = given; }, help)
      ->check(CLI::Validator(
          [](const std::string& file) {
            const std::filesystem::path path(file);
            const std::string kind = CLI::detail::to_lower(path.extension().string());
            return kind.empty() || kind == ".png"
                       ? std::string()
                       : file + " is not the name of a PNG file; name it such as " +
                             std::filesystem::path(path).replace_extension(".png").string();
          },
          ""))
      ->type_name("FILE");
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
  app_->set_help_flag("-h,--help", "Print this help");
  app_->set_version_flag("--version", name + " " + version, "Print the version");
  app_->get_formatter()->column_width(36);
  app_->failure_message([this](const CLI::App* app, const CLI::Error& error) {
    const auto commands = app->get_subcommands();
    std::string path = app->get_name();
    for (auto used = commands; !used.empty(); used = used.front()->get_subcommands()) {
      path += " " + used.front()->get_name();
    }
    const std::string unknown = UnknownWord(app_.get(), elsewhere_);
    return (unknown.empty() ? error.what() : unknown) + "\nTry: " + path + " --help\n";
  });
}

CommandLine::~CommandLine() = default;

CommandEntry CommandLine::Describe() const { return EntryOf(app_.get(), app_->get_name()); }

Command CommandLine::root() { return Command(app_.get(), &chosen_); }

int CommandLine::Run(std::vector<std::string> arguments, std::ostream& out, std::ostream& err) {
  if (!arguments.empty() && arguments.front() == "help") {
    arguments.erase(arguments.begin());
    arguments.emplace_back("--help");
  }
  std::reverse(arguments.begin(), arguments.end());  // as CLI11 takes them
  try {
    app_->parse(std::move(arguments));
  } catch (const CLI::CallForHelp& help) {
    if (UnknownWord(app_.get(), elsewhere_).empty()) return app_->exit(help, out, err);
    app_->exit(CLI::ExtrasError(app_->remaining(/*recurse=*/true)), out, err);
    return kUsage;
  } catch (const CLI::ParseError& error) {
    return app_->exit(error, out, err) == 0 ? kOk : kUsage;
  }
  if (prepare_) prepare_();
  return chosen_ ? chosen_() : kUsage;
}

}  // namespace maneuver::cli

#include "server/maneuverd/configuration.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "model/files/durable_file.h"

namespace maneuver {
namespace {

constexpr char kFileOption[] = "config";
constexpr char kPrefix[] = "MANEUVERD_";

// Options by name, with whether an empty value is one that they can have.
using Names = std::map<std::string, bool>;

bool IsFlag(const CLI::Option& option) { return option.get_expected_min() == 0; }

Names ConfigurableNames(const CLI::App& app) {
  Names names;
  for (const CLI::Option* option : app.get_options()) {
    if (!option->get_configurable()) continue;
    names[option->get_single_name()] = option->get_default_str().empty() && !IsFlag(*option);
  }
  return names;
}

// "max-batch" as MANEUVERD_MAX_BATCH.
std::string VariableOf(const std::string& name) {
  return absl::StrCat(kPrefix, absl::AsciiStrToUpper(absl::StrReplaceAll(name, {{"-", "_"}})));
}

// What follows the opening quote, up to the closing one; `rest` is left behind it.
std::optional<std::string> Unquote(absl::string_view* rest) {
  std::string value;
  while (!rest->empty()) {
    const char c = rest->front();
    rest->remove_prefix(1);
    if (c == '"') return value;
    if (c != '\\') {
      value += c;
      continue;
    }
    if (rest->empty()) break;
    const char escaped = rest->front();
    rest->remove_prefix(1);
    if (escaped != '"' && escaped != '\\' && escaped != 'n') break;
    value += escaped == 'n' ? '\n' : escaped;
  }
  return std::nullopt;
}

bool IsName(absl::string_view text) {
  return !text.empty() && std::ranges::all_of(text, [](char c) {
    return absl::ascii_islower(static_cast<unsigned char>(c)) ||
           absl::ascii_isdigit(static_cast<unsigned char>(c)) || c == '-';
  });
}

bool IsEmptyOrComment(absl::string_view text) {
  text = absl::StripLeadingAsciiWhitespace(text);
  return text.empty() || text.front() == '#';
}

// One line that is neither empty nor a comment alone.
std::optional<std::pair<std::string, std::string>> ParseLine(absl::string_view line) {
  const size_t equals = line.find('=');
  if (equals == absl::string_view::npos) return std::nullopt;
  const absl::string_view name = absl::StripAsciiWhitespace(line.substr(0, equals));
  absl::string_view rest = absl::StripAsciiWhitespace(line.substr(equals + 1));
  if (!IsName(name) || rest.empty()) return std::nullopt;
  std::string value;
  if (absl::ConsumePrefix(&rest, "\"")) {
    auto unquoted = Unquote(&rest);
    if (!unquoted) return std::nullopt;
    value = *std::move(unquoted);
  } else {
    const size_t end = std::min(rest.find_first_of(" \t\"#"), rest.size());
    value = std::string(rest.substr(0, end));
    rest.remove_prefix(end);
    if (value.empty()) return std::nullopt;
  }
  if (!IsEmptyOrComment(rest)) return std::nullopt;
  return std::make_pair(std::string(name), value);
}

std::string Quoted(const std::string& value) {
  return absl::StrCat(
      "\"", absl::StrReplaceAll(value, {{"\\", "\\\\"}, {"\"", "\\\""}, {"\n", "\\n"}}), "\"");
}

std::string ValueOf(const CLI::Option& option) {
  if (IsFlag(option)) return option.count() > 0 && option.as<bool>() ? "true" : "false";
  return option.count() > 0 ? option.results().back() : option.get_default_str();
}

bool IsNumber(const std::string& value) {
  return !value.empty() && std::ranges::all_of(value, [](char c) {
    return absl::ascii_isdigit(static_cast<unsigned char>(c)) || c == '.';
  });
}

// Names of the options on a command line.
std::set<std::string> NamesGiven(const std::vector<std::string>& arguments) {
  std::set<std::string> given;
  for (const std::string& argument : arguments) {
    if (absl::StartsWith(argument, "--")) given.insert(argument.substr(2, argument.find('=') - 2));
  }
  return given;
}

std::optional<std::string> FileOnCommandLine(const std::vector<std::string>& arguments) {
  const std::string option = absl::StrCat("--", kFileOption);
  for (size_t i = 0; i < arguments.size(); ++i) {
    if (arguments[i] == option && i + 1 < arguments.size()) return arguments[i + 1];
    if (absl::StartsWith(arguments[i], option + "=")) return arguments[i].substr(option.size() + 1);
  }
  return std::nullopt;
}

absl::StatusOr<std::vector<Setting>> FromEnvironment(const char* const* environment,
                                                     const Names& names, std::string* file) {
  std::map<std::string, std::string> variables;  // by variable, the option
  for (const auto& [name, can_be_empty] : names) variables[VariableOf(name)] = name;
  std::vector<Setting> settings;
  for (; *environment != nullptr; ++environment) {
    const std::pair<std::string, std::string> entry =
        absl::StrSplit(absl::string_view(*environment), absl::MaxSplits('=', 1));
    const auto& [variable, value] = entry;
    if (!absl::StartsWith(variable, kPrefix)) continue;
    if (variable == VariableOf(kFileOption)) {
      *file = value;
    } else if (const auto found = variables.find(variable); found != variables.end()) {
      settings.push_back({found->second, value, variable});
    } else {
      return absl::InvalidArgumentError(absl::StrCat(
          variable, ": there is no option for this environment variable; see maneuverd --help"));
    }
  }
  return settings;
}

absl::StatusOr<std::vector<Setting>> FromFile(const std::string& file, const Names& names) {
  const auto text = files::ReadInput(file);
  if (!text.ok()) {
    return absl::NotFoundError(absl::StrCat("--config: ", text.status().message()));
  }
  auto settings = ParseSettings(*text, file);
  if (!settings.ok()) return settings.status();
  for (const Setting& setting : *settings) {
    const auto known = names.find(setting.name);
    if (known == names.end()) {
      return absl::InvalidArgumentError(absl::StrCat(setting.source, ": there is no option ",
                                                     setting.name, "; see maneuverd --help"));
    }
    if (setting.value.empty() && !known->second) {
      return absl::InvalidArgumentError(
          absl::StrCat(setting.source, ": ", setting.name, " needs a value"));
    }
  }
  return settings;
}

}  // namespace

absl::StatusOr<std::vector<Setting>> ParseSettings(std::string_view text, const std::string& file) {
  std::vector<Setting> settings;
  std::map<std::string, int> lines;  // of each name
  int number = 0;
  for (const absl::string_view line :
       absl::StrSplit(absl::string_view(text.data(), text.size()), '\n')) {
    ++number;
    if (IsEmptyOrComment(line)) continue;
    const std::string source = absl::StrCat(file, ":", number);
    auto setting = ParseLine(line);
    if (!setting) {
      return absl::InvalidArgumentError(
          absl::StrCat(source, ": expected a line such as: max-batch = 32, or: log-format = \"",
                       "json\"; quotes are needed around spaces, quotes and #"));
    }
    const auto [first, is_new] = lines.emplace(setting->first, number);
    if (!is_new) {
      return absl::InvalidArgumentError(
          absl::StrCat(source, ": ", setting->first, " is set in line ", first->second, " too"));
    }
    settings.push_back({std::move(setting->first), std::move(setting->second), source});
  }
  return settings;
}

std::string PrintSettings(const CLI::App& app) {
  std::string text;
  for (const CLI::Option* option : app.get_options()) {
    if (!option->get_configurable()) continue;
    const std::string value = ValueOf(*option);
    absl::StrAppend(&text, option->get_single_name(), " = ",
                    IsNumber(value) || IsFlag(*option) ? value : Quoted(value), "\n");
  }
  return text;
}

absl::StatusOr<Configuration> Configuration::Read(const CLI::App& app,
                                                  std::vector<std::string> arguments,
                                                  const char* const* environment) {
  Configuration configuration;
  configuration.arguments_ = std::move(arguments);
  const Names names = ConfigurableNames(app);
  std::string file;
  auto settings = FromEnvironment(environment, names, &file);
  if (!settings.ok()) return settings.status();
  if (const auto given = FileOnCommandLine(configuration.arguments_)) file = *given;
  if (!file.empty()) {
    auto from_file = FromFile(file, names);
    if (!from_file.ok()) return from_file.status();
    std::ranges::move(*from_file, std::back_inserter(*settings));
  }

  const std::set<std::string> given = NamesGiven(configuration.arguments_);
  std::set<std::string> set;
  for (Setting& setting : *settings) {  // of two with the same name the first counts
    if (setting.value.empty() || given.contains(setting.name)) continue;
    if (set.insert(setting.name).second) configuration.settings_.push_back(std::move(setting));
  }
  return configuration;
}

std::vector<std::string> Configuration::CommandLine() const {
  std::vector<std::string> line = arguments_;
  for (const Setting& setting : settings_) {
    line.push_back(absl::StrCat("--", setting.name, "=", setting.value));
  }
  return line;
}

std::string Configuration::WithSource(const std::string& error) const {
  for (const Setting& setting : settings_) {
    const std::string option = "--" + setting.name;
    const size_t place = error.find(option);
    if (place == std::string::npos) continue;
    const std::string rest = error.substr(place + option.size());
    if (!rest.empty() && IsName(rest.substr(0, 1))) continue;  // a longer name
    return absl::StrCat(setting.source, ": ", error);
  }
  return error;
}

}  // namespace maneuver

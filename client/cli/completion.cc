#include "client/cli/completion.h"

#include <functional>
#include <ostream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"

namespace maneuver::cli {
namespace {

// `help` takes a command, so it is none of them.
constexpr char kHelp[] = "help";
constexpr char kAboutHelp[] = "Describe a command";

// One word of bash or zsh, whatever it holds.
std::string Quoted(const std::string& text) {
  return absl::StrCat("'", absl::StrReplaceAll(text, {{"'", "'\\''"}}), "'");
}

std::string QuotedForFish(const std::string& text) {
  return absl::StrCat("'", absl::StrReplaceAll(text, {{"\\", "\\\\"}, {"'", "\\'"}}), "'");
}

// Calls `visit` for a command and for all below it.
void ForEach(const CommandEntry& command, const std::function<void(const CommandEntry&)>& visit) {
  visit(command);
  for (const CommandEntry& below : command.commands) ForEach(below, visit);
}

// The paths of all commands below the program, as patterns of a case: 'maneuver job'|...
std::string CommandPatterns(const CommandEntry& root) {
  std::vector<std::string> paths;
  ForEach(root, [&](const CommandEntry& command) {
    if (&command != &root) paths.push_back(Quoted(command.path));
  });
  return absl::StrJoin(paths, "|");
}

// Patterns for an option of a command: 'maneuver train --seed'. Those of the program follow any
// command: *' --server'.
std::string OptionPatterns(const CommandEntry& root, const CommandEntry& command,
                           const OptionEntry& option) {
  std::vector<std::string> patterns;
  for (const std::string& flag : option.flags) {
    patterns.push_back(&command == &root ? "*" + Quoted(" " + flag)
                                         : Quoted(command.path + " " + flag));
  }
  return absl::StrJoin(patterns, "|");
}

// A case for each option that takes a value.
//   complete: what the shell does for it.
std::string ValueCases(const CommandEntry& root,
                       const std::function<std::string(const OptionEntry&)>& complete) {
  std::string cases;
  ForEach(root, [&](const CommandEntry& command) {
    for (const OptionEntry& option : command.options) {
      if (!option.takes_value) continue;
      absl::StrAppend(&cases, "    (", OptionPatterns(root, command, option), ") ",
                      complete(option), "; return ;;\n");
    }
  });
  return cases;
}

// Flags of a command, and of the program, which may follow it.
std::vector<std::string> FlagsAt(const CommandEntry& root, const CommandEntry& command) {
  std::vector<std::string> flags;
  const auto add = [&](const CommandEntry& of) {
    for (const OptionEntry& option : of.options) {
      for (const std::string& flag : option.flags) {
        if (flag != "--version" || &command == &root) flags.push_back(flag);
      }
    }
  };
  add(command);
  if (&command != &root) {
    for (const OptionEntry& option : root.options) {
      // Each command has its own --help.
      if (option.flags.back() == "--help" || option.flags.back() == "--version") continue;
      flags.insert(flags.end(), option.flags.begin(), option.flags.end());
    }
  }
  return flags;
}

}  // namespace

std::string BashCompletion(const CommandEntry& root) {
  const std::string program = root.path;
  std::string words;
  ForEach(root, [&](const CommandEntry& command) {
    std::vector<std::string> names;
    for (const CommandEntry& below : command.commands) names.push_back(below.name());
    if (&command == &root) names.emplace_back(kHelp);
    absl::StrAppend(&words, "    (", Quoted(command.path),
                    ") commands=", Quoted(absl::StrJoin(names, " ")),
                    " options=", Quoted(absl::StrJoin(FlagsAt(root, command), " ")), " ;;\n");
  });
  const std::string values = ValueCases(root, [](const OptionEntry& option) -> std::string {
    if (option.choices.empty()) return "COMPREPLY=()";
    return absl::StrCat("COMPREPLY=($(compgen -W ", Quoted(absl::StrJoin(option.choices, " ")),
                        " -- \"$word\"))");
  });
  return absl::StrCat("# Completion of ", program, " for bash, made by: ", program,
                      " completion bash\n_", program,
                      "() {\n"
                      "  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]}\n"
                      "  local at=",
                      program,
                      " commands='' options='' i\n"
                      "  # bash makes three words of --output=json.\n"
                      "  if [[ $word == '=' ]]; then word=''; "
                      "elif [[ $before == '=' ]]; then before=${COMP_WORDS[COMP_CWORD-2]}; fi\n"
                      "  for ((i = 1; i < COMP_CWORD; ++i)); do\n"
                      "    case \"$at ${COMP_WORDS[i]}\" in\n    (",
                      CommandPatterns(root),
                      ") at+=\" ${COMP_WORDS[i]}\" ;;\n"
                      "    esac\n  done\n"
                      "  case \"$at $before\" in\n",
                      values,
                      "  esac\n"
                      "  case \"$at\" in\n",
                      words,
                      "  esac\n"
                      "  if [[ $word == -* ]]; then commands=$options; fi\n"
                      "  COMPREPLY=($(compgen -W \"$commands\" -- \"$word\"))\n"
                      "}\n"
                      "complete -o bashdefault -o default -F _",
                      program, " ", program, "\n");
}

std::string ZshCompletion(const CommandEntry& root) {
  const std::string program = root.path;
  const auto describe = [](const std::string& word, const std::string& help) {
    return Quoted(absl::StrCat(word, ":", help));
  };
  std::string words;
  ForEach(root, [&](const CommandEntry& command) {
    std::vector<std::string> names;
    for (const CommandEntry& below : command.commands) {
      names.push_back(describe(below.name(), below.summary));
    }
    if (&command == &root) names.push_back(describe(kHelp, kAboutHelp));
    std::vector<std::string> flags;
    for (const OptionEntry& option : command.options) {
      for (const std::string& flag : option.flags) flags.push_back(describe(flag, option.help));
    }
    absl::StrAppend(&words, "    (", Quoted(command.path), ") commands=(",
                    absl::StrJoin(names, " "), ") options+=(", absl::StrJoin(flags, " "), ") ;;\n");
  });
  std::vector<std::string> everywhere;
  for (const OptionEntry& option : root.options) {
    if (option.flags.back() == "--help" || option.flags.back() == "--version") continue;
    for (const std::string& flag : option.flags) everywhere.push_back(describe(flag, option.help));
  }
  const std::string values = ValueCases(root, [](const OptionEntry& option) -> std::string {
    if (option.choices.empty()) return "_files";
    return absl::StrCat("compadd -- ", absl::StrJoin(option.choices, " "));
  });
  return absl::StrCat(
      "#compdef ", program, "\n# Completion of ", program, " for zsh, made by: ", program,
      " completion zsh\n_", program,
      "() {\n"
      "  local at=",
      program,
      " before=${words[CURRENT-1]} word\n"
      "  local -a commands options\n"
      "  if [[ $PREFIX == --*=* ]]; then before=${PREFIX%%=*}; compset -P '*='; fi\n"
      "  for word in ${words[2,CURRENT-1]}; do\n"
      "    case \"$at $word\" in\n    (",
      CommandPatterns(root),
      ") at+=\" $word\" ;;\n"
      "    esac\n  done\n"
      "  case \"$at $before\" in\n",
      values,
      "  esac\n"
      "  [[ $at == ",
      program, " ]] || options=(", absl::StrJoin(everywhere, " "),
      ")\n"
      "  case \"$at\" in\n",
      words,
      "  esac\n"
      "  if [[ $PREFIX == -* ]]; then _describe -o option options\n"
      "  elif (( $#commands )); then _describe command commands\n"
      "  else _files; fi\n"
      "}\n"
      "# From a folder of $fpath this file is the function; otherwise it is read.\n"
      "if [[ ${funcstack[1]} == _",
      program, " ]]; then _", program, " \"$@\"; else compdef _", program, " ", program, "; fi\n");
}

std::string FishCompletion(const CommandEntry& root) {
  const std::string program = root.path;
  std::vector<std::string> paths;
  std::string rules;
  ForEach(root, [&](const CommandEntry& command) {
    if (&command != &root) paths.push_back(QuotedForFish(command.path));
    const std::string condition = absl::StrCat("complete -c ", program, " -n \"__", program, "_at ",
                                               QuotedForFish(command.path), "\"");
    for (const CommandEntry& below : command.commands) {
      absl::StrAppend(&rules, condition, " -f -a ", below.name(), " -d ",
                      QuotedForFish(below.summary), "\n");
    }
    if (&command == &root) {
      absl::StrAppend(&rules, condition, " -f -a ", kHelp, " -d ", QuotedForFish(kAboutHelp), "\n");
    }
    for (const OptionEntry& option : command.options) {
      const bool of_program = &command == &root && option.flags.back() != "--help" &&
                              option.flags.back() != "--version";
      absl::StrAppend(&rules, of_program ? absl::StrCat("complete -c ", program) : condition);
      for (const std::string& flag : option.flags) {
        absl::StrAppend(&rules,
                        flag.starts_with("--") ? " -l " + flag.substr(2) : " -s " + flag.substr(1));
      }
      if (!option.choices.empty()) {
        absl::StrAppend(&rules, " -x -a ", QuotedForFish(absl::StrJoin(option.choices, " ")));
      } else if (option.takes_value) {
        absl::StrAppend(&rules, " -r");
      }
      absl::StrAppend(&rules, " -d ", QuotedForFish(option.help), "\n");
    }
  });
  return absl::StrCat("# Completion of ", program, " for fish, made by: ", program,
                      " completion fish\nfunction __", program, "_at\n  set -l at ", program,
                      "\n  for word in (commandline -opc)[2..-1]\n"
                      "    switch \"$at $word\"\n      case ",
                      absl::StrJoin(paths, " "),
                      "\n        set at \"$at $word\"\n    end\n  end\n"
                      "  test \"$at\" = \"$argv[1]\"\nend\n",
                      rules);
}

void AddCompletion(const CommandLine& line, Command& root, Environment& environment) {
  Command group = root.Add("completion", "A script that completes commands in your shell");
  Command bash = group.Add("bash", "For bash",
                           "Example: maneuver completion bash > "
                           "~/.local/share/bash-completion/completions/maneuver\n"
                           "         source <(maneuver completion bash)");
  bash.Run([&line, &environment]() -> int {
    environment.out << BashCompletion(line.Describe());
    return kOk;
  });
  Command zsh = group.Add("zsh", "For zsh",
                          "The folder has to be one of $fpath, before compinit.\n"
                          "Example: maneuver completion zsh > ~/.zsh/completions/_maneuver");
  zsh.Run([&line, &environment]() -> int {
    environment.out << ZshCompletion(line.Describe());
    return kOk;
  });
  Command fish =
      group.Add("fish", "For fish",
                "Example: maneuver completion fish > ~/.config/fish/completions/maneuver.fish");
  fish.Run([&line, &environment]() -> int {
    environment.out << FishCompletion(line.Describe());
    return kOk;
  });
}

}  // namespace maneuver::cli

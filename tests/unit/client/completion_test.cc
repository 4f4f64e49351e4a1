// What each shell offers, by the scripts that the command prints, asked in the shell itself.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "tests/unit/client/run_maneuver.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::completion_test {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Not;
using Words = std::vector<std::string>;

// What a script writes, by lines; whether it succeeded in *status.
Words LinesOf(const std::string& command, int* status = nullptr) {
  std::string output;
  FILE* pipe = popen(command.c_str(), "r");
  std::array<char, 4096> buffer{};
  for (size_t n; (n = fread(buffer.data(), 1, buffer.size(), pipe)) > 0;) {
    output.append(buffer.data(), n);
  }
  const int ended = pclose(pipe);
  if (status != nullptr) *status = ended;
  return absl::StrSplit(output, '\n', absl::SkipEmpty());
}

class CompletionTest : public ::testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    int status = 0;
    LinesOf("command -v " + GetParam(), &status);
    if (status != 0) GTEST_SKIP() << GetParam() << " is not installed";
    const Result printed = Maneuver({"completion", GetParam()});
    ASSERT_EQ(printed.status, 0) << printed.err;
    std::ofstream(script_) << printed.out;
  }

  // What the shell offers for the last word.
  Words Offered(const Words& words) const {
    const std::string quoted = absl::StrJoin(words, " ", [](std::string* out, const auto& word) {
      absl::StrAppend(out, "'", word, "'");
    });
    const std::string source = "source '" + script_.string() + "'; ";
    std::string asked;
    if (GetParam() == "bash") {
      asked = absl::StrCat("COMP_WORDS=(", quoted, "); COMP_CWORD=", words.size() - 1,
                           "; _maneuver; printf \"%s\\n\" \"${COMPREPLY[@]}\"");
    } else if (GetParam() == "zsh") {
      // The script calls these of zsh's own, which offer to a person at a terminal.
      asked = absl::StrCat("words=(", quoted, "); CURRENT=", words.size(), "; PREFIX='",
                           words.back(), "'; _maneuver");
      return LinesOf(
          absl::StrCat("zsh -f <<'END'\n"
                       "compdef() { : }\n_files() { print FILES }\n"
                       "compadd() { shift; print -l -- \"$@\" }\n"
                       "compset() { PREFIX=${PREFIX#*=} }\n"
                       "_describe() { local entries=${@[-1]}; print -l -- ${(P)entries%%:*} }\n",
                       source, asked, "\nEND\n"));
    } else {
      asked = "complete -C '" + absl::StrJoin(words, " ") + "'";
    }
    std::ofstream(folder_ / "ask") << source << asked << "\n";
    return LinesOf(absl::StrCat("HOME='", folder_.path().string(), "' ", GetParam(),
                                GetParam() == "bash" ? " --norc '" : " --no-config '",
                                (folder_ / "ask").string(), "'"));
  }

  const TemporaryFolder folder_;
  const std::filesystem::path script_ = folder_ / "script";
};

INSTANTIATE_TEST_SUITE_P(Shells, CompletionTest, ::testing::Values("bash", "zsh", "fish"),
                         [](const auto& shell) { return shell.param; });

// A line of fish is WORD<tab>DESCRIPTION, and zsh's words are not filtered by what was typed.
MATCHER_P(Is, word, "") { return arg == word || arg.starts_with(std::string(word) + "\t"); }

TEST_P(CompletionTest, OffersCommands) {
  EXPECT_THAT(Offered({"maneuver", "mod"}), Contains(Is("model")));
  EXPECT_THAT(Offered({"maneuver", "model", "p"}),
              AllOf(Contains(Is("pull")), Contains(Is("push")), Contains(Is("promote"))));
  EXPECT_THAT(Offered({"maneuver", "model", "p"}), Not(Contains(Is("predict"))));
  // After an option with its value, too.
  EXPECT_THAT(Offered({"maneuver", "--output", "json", "model", "pu"}), Contains(Is("pull")));
}

TEST_P(CompletionTest, OffersHelpAndTheCommandsAfterIt) {
  EXPECT_THAT(Offered({"maneuver", "he"}), AllOf(Contains(Is("help")), Contains(Is("health"))));
  EXPECT_THAT(Offered({"maneuver", "help", "mod"}), Contains(Is("model")));
}

TEST_P(CompletionTest, OffersOptionsOfTheCommandAndOfTheProgram) {
  EXPECT_THAT(Offered({"maneuver", "job", "list", "--s"}),
              AllOf(Contains(Is("--state")), Contains(Is("--since")), Contains(Is("--server"))));
  EXPECT_THAT(Offered({"maneuver", "job", "list", "--s"}), Not(Contains(Is("--speed"))));
}

TEST_P(CompletionTest, OffersTheChoicesOfAnOption) {
  EXPECT_THAT(Offered({"maneuver", "job", "list", "--state", "fail"}), Contains(Is("failed")));
  EXPECT_THAT(Offered({"maneuver", "train", "town", "--promote", "if"}),
              Contains(Is("if-no-worse")));
  EXPECT_THAT(Offered({"maneuver", "health", "--output", "js"}), Contains(Is("json")));
}

TEST_P(CompletionTest, LeavesOtherWordsToTheShell) {
  const Words offered = Offered({"maneuver", "model", "push", "no-such-file"});
  if (GetParam() == "zsh") {
    EXPECT_THAT(offered, ElementsAre("FILES"));
  } else {
    EXPECT_THAT(offered, IsEmpty());
  }
}

TEST_P(CompletionTest, NamesEveryCommand) {
  const Words offered = Offered({"maneuver", ""});
  for (const char* command : {"train", "predict", "dataset", "load", "completion"}) {
    EXPECT_THAT(offered, Contains(Is(command))) << command;
  }
}

TEST(BashCompletionTest, CompletesAValueAfterAnEqualsSign) {
  const TemporaryFolder folder;
  std::ofstream(folder / "script") << Maneuver({"completion", "bash"}).out;
  const std::string ask = "bash --norc -c 'source " + (folder / "script").string() +
                          "; COMP_WORDS=(maneuver health --output = js); COMP_CWORD=4; _maneuver; "
                          "printf \"%s\\n\" \"${COMPREPLY[@]}\"'";
  EXPECT_THAT(LinesOf(ask), ElementsAre("json"));
}

TEST(CompletionCommandTest, RequiresAShell) {
  EXPECT_EQ(Maneuver({"completion"}).status, 2);
  EXPECT_EQ(Maneuver({"completion", "tcsh"}).status, 2);
}

}  // namespace
}  // namespace maneuver::cli::completion_test

#include "server/maneuverd/token_command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include "server/security/identities.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::token_command_test {
namespace {

namespace fs = std::filesystem;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

class TokenCommandTest : public ::testing::Test {
 protected:
  // Runs "maneuverd token ARGUMENTS --tokens FILE".
  int Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "token");
    arguments.insert(arguments.end(), {"--tokens", file_.string()});
    std::vector<const char*> argv;
    for (const std::string& argument : arguments) argv.push_back(argument.c_str());
    ::testing::internal::CaptureStdout();
    ::testing::internal::CaptureStderr();
    const int status = RunTokenCommand(static_cast<int>(argv.size()), argv.data(), now_);
    err_ = ::testing::internal::GetCapturedStderr();
    out_ = ::testing::internal::GetCapturedStdout();
    return status;
  }

  // The token that "create" prints.
  std::string Create(const std::string& name, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"create", "--name", name, "--roles", "predict,train"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    EXPECT_EQ(Run(arguments), 0) << err_;
    return out_.substr(0, out_.find('\n'));
  }

  std::string Text() const {
    std::ostringstream text;
    text << std::ifstream(file_).rdbuf();
    return text.str();
  }
  void Write(const std::string& text) const { std::ofstream(file_) << text; }

  security::Identities Identities() const {
    auto identities = security::Identities::Parse(Text());
    EXPECT_TRUE(identities.ok()) << identities.status();
    return *std::move(identities);
  }

  const TemporaryFolder folder_;
  fs::path file_ = folder_ / "tokens";
  // 2027-01-15 08:00:00 UTC.
  const absl::Time now_ = absl::FromUnixSeconds(1'800'000'000);
  std::string out_;
  std::string err_;
};

TEST_F(TokenCommandTest, CreatePrintsATokenThatTheFileKnows) {
  const std::string token = Create("planner");
  EXPECT_THAT(token, ContainsRegex("^mvr_[0-9a-f]{64}$"));
  EXPECT_EQ(out_, token + "\n");
  EXPECT_THAT(Text() + err_, Not(HasSubstr(token)));
  const auto identities = Identities();
  const security::Identity* planner = identities.FindToken(token);
  ASSERT_NE(planner, nullptr);
  EXPECT_EQ(planner->name, "planner");
  EXPECT_EQ(planner->roles.ToString(), "predict,train");
  EXPECT_FALSE(planner->expires.has_value());
  struct stat about {};
  ASSERT_EQ(stat(file_.c_str(), &about), 0);
  EXPECT_EQ(about.st_mode & 0777, 0600u);
}

TEST_F(TokenCommandTest, CreateTakesASpanOrATimeAsExpiry) {
  const std::vector<std::pair<std::string, absl::Duration>> cases = {
      {"90d", absl::Hours(90 * 24)},
      {"12h", absl::Hours(12)},
      {"30m", absl::Minutes(30)},
      {"2027-01-16", absl::Hours(16)},
      {"2027-01-15T10:00:00Z", absl::Hours(2)},
      {"2027-01-15T10:00:00+01:00", absl::Hours(1)}};
  for (const auto& [text, span] : cases) {
    const std::string token = Create("guest", {"--expires", text});
    EXPECT_EQ(Identities().FindToken(token)->expires, now_ + span) << text;
  }
}

TEST_F(TokenCommandTest, CreateRefusesAnExpiryThatIsNotInTheFuture) {
  for (const char* text : {"0d", "-1d", "2027-01-15", "2020-01-01T00:00:00Z", "soon", "d", "5w",
                           "99999999999999999d", "infinite-future"}) {
    EXPECT_EQ(
        Run({"create", "--name", "guest", "--roles", "predict", std::string("--expires=") + text}),
        2)
        << text;
    EXPECT_THAT(err_, HasSubstr("--expires")) << text;
    EXPECT_EQ(out_, "") << text;
  }
  EXPECT_FALSE(fs::exists(file_));
}

TEST_F(TokenCommandTest, CreateRefusesAWrongNameOrRole) {
  EXPECT_EQ(Run({"create", "--name", "a b", "--roles", "predict"}), 2);
  EXPECT_EQ(Run({"create", "--name", "a", "--roles", "fly"}), 2);
  EXPECT_FALSE(fs::exists(file_));
}

TEST_F(TokenCommandTest, CreateNamesTheWholePathOfAFileThatItCannotWrite) {
  file_ = folder_ / "none/tokens";
  EXPECT_NE(Run({"create", "--name", "planner", "--roles", "predict"}), 0);
  EXPECT_THAT(err_, HasSubstr(file_.string()));
  EXPECT_EQ(out_, "");
}

TEST_F(TokenCommandTest, ListShowsNamesRolesAndExpiry) {
  const std::string token = Create("planner");
  Create("guest", {"--expires", "2027-02-01"});
  std::ofstream(file_, std::ios::app)
      << "late admin sha256:" << std::string(64, 'a') << " expires=2027-01-01T00:00:00Z\n"
      << "fleet predict san:fleet.example\n";
  ASSERT_EQ(Run({"list"}), 0) << err_;
  EXPECT_THAT(out_, StartsWith("NAME "));
  EXPECT_THAT(out_, ContainsRegex("planner +predict,train +token [0-9a-f]{12} +never\n"));
  EXPECT_THAT(out_, ContainsRegex("guest +.*2027-02-01T00:00:00Z\n"));
  EXPECT_THAT(out_, ContainsRegex("late +admin +token a{12} +expired 2027-01-01T00:00:00Z\n"));
  EXPECT_THAT(out_, ContainsRegex("fleet +predict +san:fleet.example +never\n"));
  EXPECT_THAT(out_, Not(HasSubstr(token)));
}

TEST_F(TokenCommandTest, RevokeRemovesAllTokensOfAName) {
  const std::string first = Create("planner");
  const std::string second = Create("planner");
  const std::string other = Create("operator");
  std::ofstream(file_, std::ios::app) << "# kept\nplanner predict san:planner.example\n";
  ASSERT_EQ(Run({"revoke", "--name", "planner"}), 0) << err_;
  EXPECT_EQ(Identities().FindToken(first), nullptr);
  EXPECT_EQ(Identities().FindToken(second), nullptr);
  EXPECT_NE(Identities().FindToken(other), nullptr);
  EXPECT_THAT(Text(), HasSubstr("# kept\nplanner predict san:planner.example\n"));
  EXPECT_THAT(err_, HasSubstr("planner may still call by certificate"));
  EXPECT_EQ(Run({"revoke", "--name", "planner"}), 1);
  EXPECT_THAT(err_, HasSubstr("no such token"));
}

TEST_F(TokenCommandTest, RevokeAcceptsTheIdThatListShows) {
  const std::string first = Create("planner");
  const std::string second = Create("planner");
  const std::string id = Identities().lines().front().credential.substr(0, 12);
  ASSERT_EQ(Run({"revoke", "--id", id}), 0) << err_;
  EXPECT_EQ(Identities().FindToken(first), nullptr);
  EXPECT_NE(Identities().FindToken(second), nullptr);
  EXPECT_EQ(Run({"revoke", "--id", "abc"}), 2);
}

TEST_F(TokenCommandTest, RevokeRefusesAnAmbiguousId) {
  const std::string lines = "a predict sha256:" + std::string(64, 'a') +
                            "\nb predict sha256:" + std::string(63, 'a') + "b\n";
  Write(lines);
  EXPECT_EQ(Run({"revoke", "--id", std::string(12, 'a')}), 1);
  EXPECT_EQ(Text(), lines);
}

TEST_F(TokenCommandTest, RevokeRemovesExpiredTokens) {
  const std::string token = Create("guest", {"--expires", "1h"});
  std::ofstream(file_, std::ios::app)
      << "late predict sha256:" << std::string(64, 'a') << " expires=2027-01-01T00:00:00Z\n";
  ASSERT_EQ(Run({"revoke", "--expired"}), 0) << err_;
  EXPECT_THAT(out_, HasSubstr("of late"));
  EXPECT_EQ(Identities().lines().size(), 1u);
  EXPECT_NE(Identities().FindToken(token), nullptr);
  EXPECT_EQ(Run({"revoke", "--expired"}), 0);
}

TEST_F(TokenCommandTest, RevokeRefusesAFileThatTheServerWouldNotRead) {
  Create("planner");
  const std::string text = Text() + "oops\n";
  Write(text);
  EXPECT_EQ(Run({"revoke", "--name", "planner"}), 1);
  EXPECT_THAT(err_, HasSubstr("line 2"));
  EXPECT_EQ(Text(), text);
}

TEST_F(TokenCommandTest, RevokeRequiresExactlyOneChoice) {
  EXPECT_EQ(Run({"revoke"}), 2);
  EXPECT_EQ(Run({"revoke", "--name", "a", "--expired"}), 2);
}

TEST_F(TokenCommandTest, FailsIfTheTokenCannotBeShown) {
  std::streambuf* const shown = std::cout.rdbuf(nullptr);  // no write succeeds
  const int created = Run({"create", "--name", "planner", "--roles", "predict"});
  const std::string error = err_;
  std::cout.clear(std::ios::badbit);
  const int listed = Run({"list"});
  std::cout.rdbuf(shown);
  EXPECT_EQ(created, 1);
  EXPECT_THAT(error, HasSubstr("the token is lost: remove it with maneuverd token revoke"));
  EXPECT_EQ(listed, 1);
}

}  // namespace
}  // namespace maneuver::token_command_test

#include "server/security/access_control.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <thread>
#include <vector>

#include "server/errors/error_details.h"
#include "server/monitoring/prometheus_metrics.h"
#include "server/security/secret_file.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::security::access_control_test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr char kPredict[] = "/maneuver.v1.PredictionService/Predict";
constexpr char kTrain[] = "/maneuver.v1.TrainingService/Train";
constexpr char kHealth[] = "/grpc.health.v1.Health/Check";

RoleSet Predict() { return *RoleSet::Parse("predict"); }

Credentials Bearer(const std::string& token) {
  return {.authorization = {"Bearer " + token}, .peer = "ipv4:10.0.0.1"};
}

class AccessControlTest : public ::testing::Test {
 protected:
  void SetUp() override {
    options_.identities = folder_ / "tokens";
    Write(*TokenLine("planner", Predict(), "first"));
  }

  void Write(const std::string& text) {
    fs::remove(options_.identities);
    ASSERT_TRUE(AppendLine(options_.identities, text).ok());
  }
  std::unique_ptr<AccessControl> Create() {
    auto access = AccessControl::Create(options_, *metrics_);
    EXPECT_TRUE(access.ok()) << access.status();
    return *std::move(access);
  }

  const TemporaryFolder folder_;
  AccessOptions options_;
  const std::unique_ptr<monitoring::PrometheusMetrics> metrics_ =
      monitoring::PrometheusMetrics::Create();
};

TEST_F(AccessControlTest, ChecksTheIdentityBeforeTheRole) {
  const auto access = Create();
  EXPECT_TRUE(access->Admit(kPredict, Bearer("first")).ok());
  EXPECT_EQ(errors::ReasonOf(access->Admit(kTrain, Bearer("first"))), "ROLE_MISSING");
  EXPECT_EQ(errors::ReasonOf(access->Admit(kPredict, Bearer("second"))), "TOKEN_UNKNOWN");
  EXPECT_EQ(errors::ReasonOf(access->Admit(kPredict, {})), "CREDENTIALS_MISSING");
  // The identity is checked first: a stranger does not learn which methods exist.
  EXPECT_EQ(errors::ReasonOf(access->Admit("/x/Y", {})), "CREDENTIALS_MISSING");
  EXPECT_EQ(errors::ReasonOf(access->Admit("/x/Y", Bearer("first"))), "METHOD_NOT_DECLARED");
  EXPECT_TRUE(access->Admit(kHealth, {}).ok());
  // Everything is counted, under names that no caller chooses.
  const std::string page = metrics_->Page();
  EXPECT_THAT(page, HasSubstr("maneuver_refused_calls_total{reason=\"CREDENTIALS_MISSING\"} 2"));
  EXPECT_THAT(page, HasSubstr("maneuver_refused_calls_total{reason=\"ROLE_MISSING\"} 1"));
  EXPECT_THAT(page, HasSubstr("maneuver_refused_calls_total{reason=\"METHOD_NOT_DECLARED\"} 1"));
  EXPECT_THAT(page, HasSubstr("maneuver_refused_calls_total{reason=\"RATE_LIMITED\"} 0"));
}

TEST_F(AccessControlTest, WithoutIdentitiesAnyoneMayCallDeclaredMethods) {
  options_.identities.clear();
  const auto access = Create();
  EXPECT_TRUE(access->Admit(kPredict, {}).ok());
  EXPECT_TRUE(access->Admit(kTrain, Bearer("any")).ok());
  EXPECT_EQ(errors::ReasonOf(access->Admit("/x/Y", {})), "METHOD_NOT_DECLARED");
}

TEST_F(AccessControlTest, LimitsRatesByIdentityOrElseByAddress) {
  options_.calls_per_second = 1.0;
  Write(*TokenLine("planner", Predict(), "first") + *TokenLine("planner", Predict(), "second") +
        *TokenLine("other", Predict(), "third"));
  const auto access = Create();
  EXPECT_TRUE(access->Admit(kPredict, Bearer("first")).ok());
  const absl::Status refused = access->Admit(kPredict, Bearer("second"));  // the same planner
  EXPECT_TRUE(absl::IsResourceExhausted(refused));
  EXPECT_TRUE(errors::RetryDelay(refused).has_value());
  EXPECT_TRUE(access->Admit(kPredict, Bearer("third")).ok());

  options_.identities.clear();
  const auto open = Create();
  EXPECT_TRUE(open->Admit(kPredict, {.peer = "ipv4:10.0.0.1"}).ok());
  EXPECT_FALSE(open->Admit(kPredict, {.peer = "ipv4:10.0.0.1"}).ok());
  EXPECT_TRUE(open->Admit(kPredict, {.peer = "ipv4:10.0.0.2"}).ok());
  // A balancer has one address, and asks often.
  for (int i = 0; i < 10; ++i) {
    EXPECT_TRUE(open->Admit(kHealth, {.peer = "ipv4:10.0.0.1"}).ok());
  }
}

// Who has one IPv6 address has 2^64 of them.
TEST_F(AccessControlTest, CountsANetworkOfIpv6AsOneClient) {
  options_.calls_per_second = 1.0;
  options_.targets_per_second = 1.0;
  options_.identities.clear();
  const auto open = Create();
  EXPECT_TRUE(open->Admit(kPredict, {.peer = "ipv6:%5B2001:db8::1%5D"}).ok());
  EXPECT_FALSE(open->Admit(kPredict, {.peer = "ipv6:%5B2001:db8::ffff:2:3:4%5D"}).ok());
  EXPECT_TRUE(open->Admit(kPredict, {.peer = "ipv6:%5B2001:db8:0:1::1%5D"}).ok());
  EXPECT_TRUE(open->AdmitTargets({.peer = "ipv6:%5B2001:db8::1%5D"}, 1).ok());
  EXPECT_FALSE(open->AdmitTargets({.peer = "ipv6:%5B2001:db8::2%5D"}, 1).ok());

  EXPECT_EQ(NetworkOf("ipv6:%5B2001:db8:1:2:3:4:5:6%5D"), "ipv6:2001:db8:1:2::/64");
  EXPECT_EQ(NetworkOf("ipv6:%5Bfe80::1%25eth0%5D"), "ipv6:fe80::/64");
  EXPECT_EQ(NetworkOf("ipv6:%5B::ffff:10.0.0.1%5D"), "ipv4:10.0.0.1");
  EXPECT_EQ(NetworkOf("ipv4:10.0.0.1"), "ipv4:10.0.0.1");
  for (const char* other : {"", "unix:", "ipv6:%5B", "ipv6:%5Bx%5D"}) {
    EXPECT_EQ(NetworkOf(other), other);
  }
}

TEST_F(AccessControlTest, RefusedCallsDoNotUseUpTheRateOfOthers) {
  options_.calls_per_second = 1.0;
  const auto access = Create();
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(access->Admit(kTrain, Bearer("first")).ok());
  EXPECT_TRUE(access->Admit(kPredict, Bearer("first")).ok());
}

TEST_F(AccessControlTest, ReloadsChangesAndIgnoresInvalidFiles) {
  const auto access = Create();
  EXPECT_FALSE(*access->Reload());
  Write(*TokenLine("planner", Predict(), "second"));
  EXPECT_TRUE(*access->Reload());
  EXPECT_FALSE(access->Admit(kPredict, Bearer("first")).ok());
  EXPECT_TRUE(access->Admit(kPredict, Bearer("second")).ok());
  Write("planner predict\n");
  EXPECT_TRUE(absl::IsInvalidArgument(access->Reload().status()));
  EXPECT_TRUE(access->Admit(kPredict, Bearer("second")).ok());
  fs::remove(options_.identities);
  EXPECT_TRUE(absl::IsNotFound(access->Reload().status()));
  EXPECT_TRUE(access->Admit(kPredict, Bearer("second")).ok());
  // An empty file is valid: it removes all identities.
  Write("\n");
  EXPECT_TRUE(*access->Reload());
  EXPECT_FALSE(access->Admit(kPredict, Bearer("second")).ok());
}

class ExpiryTest : public AccessControlTest {
 protected:
  void SetUp() override {
    AccessControlTest::SetUp();
    Write(*TokenLine("guest", Predict(), "first", now_ + absl::Minutes(1)));
    options_.targets_per_second = 1000.0;
    auto access = AccessControl::Create(options_, *metrics_, [this] { return now_; });
    ASSERT_TRUE(access.ok()) << access.status();
    access_ = *std::move(access);
  }

  // What the log says of a refused call.
  std::string Refuse(const std::string& token, absl::Status* status) {
    ::testing::internal::CaptureStderr();
    *status = access_->Admit(kPredict, Bearer(token));
    return ::testing::internal::GetCapturedStderr();
  }

  absl::Time now_ = absl::FromUnixSeconds(1'800'000'000);
  std::unique_ptr<AccessControl> access_;
};

TEST_F(ExpiryTest, RefusesATokenThatHasExpired) {
  now_ += absl::Seconds(59);
  EXPECT_TRUE(access_->Admit(kPredict, Bearer("first")).ok());
  EXPECT_EQ(access_->NameOf(Bearer("first")), "guest");
  now_ += absl::Seconds(1);
  EXPECT_FALSE(access_->Admit(kPredict, Bearer("first")).ok());
  EXPECT_EQ(errors::ReasonOf(access_->AdmitTargets(Bearer("first"), 1)), "TOKEN_UNKNOWN");
  EXPECT_EQ(access_->NameOf(Bearer("first")), "");
}

TEST_F(ExpiryTest, OnlyTheLogTellsExpiredFromUnknown) {
  now_ += absl::Minutes(2);
  absl::Status expired;
  absl::Status unknown;
  const std::string of_expired = Refuse("first", &expired);
  const std::string of_unknown = Refuse("second", &unknown);
  EXPECT_EQ(expired, unknown);
  EXPECT_EQ(errors::ReasonOf(expired), "TOKEN_UNKNOWN");
  EXPECT_THAT(of_expired, HasSubstr("TOKEN_EXPIRED"));
  EXPECT_THAT(of_expired, HasSubstr("name:guest"));
  EXPECT_THAT(of_unknown, HasSubstr("TOKEN_UNKNOWN"));
  EXPECT_THAT(metrics_->Page(),
              HasSubstr("maneuver_refused_calls_total{reason=\"TOKEN_UNKNOWN\"} 2"));
}

TEST_F(ExpiryTest, EndsALongCallWhoseTokenExpires) {
  int refused = 0;
  const auto call =
      access_->Watch(kPredict, Bearer("first"), [&](const absl::Status&) { ++refused; });
  ASSERT_TRUE(access_->Reload().ok());
  ASSERT_TRUE(access_->Reload().ok());
  EXPECT_EQ(refused, 0);
  now_ += absl::Minutes(1);
  ASSERT_TRUE(access_->Reload().ok());
  EXPECT_EQ(refused, 1);
}

TEST_F(AccessControlTest, CallsAndReloadsRunConcurrently) {
  const auto access = Create();
  std::atomic<bool> stop = false;
  std::vector<std::thread> callers;
  for (int i = 0; i < 3; ++i) {
    callers.emplace_back([&] {
      // Every version of the file contains the planner.
      while (!stop) EXPECT_TRUE(access->Admit(kPredict, Bearer("first")).ok());
    });
  }
  for (int i = 0; i < 50; ++i) {
    const std::string more = i % 2 == 0 ? "other train cn:x\n" : "";
    const fs::path next = folder_ / "next";
    fs::remove(next);
    ASSERT_TRUE(AppendLine(next, *TokenLine("planner", Predict(), "first") + more).ok());
    fs::rename(next, options_.identities);
    EXPECT_TRUE(access->Reload().ok());
  }
  stop = true;
  for (std::thread& caller : callers) caller.join();
}

TEST(SecretFileTest, RefusesAFileThatOthersMayReadAndNamesTheRemedy) {
  const TemporaryFolder folder;
  const fs::path file = folder / "secret";
  ASSERT_TRUE(AppendLine(file, "a\n").ok());
  EXPECT_EQ(*ReadSecretFile(file), "a\n");
  for (const fs::perms open : {fs::perms::others_read, fs::perms::others_write,
                               fs::perms::group_write, fs::perms::others_exec}) {
    fs::permissions(file, open, fs::perm_options::add);
    const auto refused = ReadSecretFile(file);
    EXPECT_TRUE(absl::IsPermissionDenied(refused.status()));
    EXPECT_THAT(refused.status().message(), HasSubstr("chmod 600 " + file.string()));
    fs::permissions(file, open, fs::perm_options::remove);
  }
  fs::permissions(file, fs::perms::group_read, fs::perm_options::add);
  EXPECT_TRUE(ReadSecretFile(file).ok());
  // Permissions stay as they were, and the last line is completed first.
  std::ofstream(file) << "a";
  ASSERT_TRUE(AppendLine(file, "b\n").ok());
  EXPECT_EQ(*ReadSecretFile(file), "a\nb\n");
  EXPECT_NE(fs::status(file).permissions() & fs::perms::group_read, fs::perms::none);
}

// To open a pipe for reading waits for a writer: nothing would be reloaded any more.
TEST(SecretFileTest, RefusesAPipeAndAFolderAtOnce) {
  const TemporaryFolder folder;
  ASSERT_EQ(mkfifo((folder / "pipe").c_str(), 0600), 0);
  EXPECT_TRUE(absl::IsInvalidArgument(ReadSecretFile(folder / "pipe").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(ReadReloadedFile(folder.path()).status()));
}

TEST(SecretFileTest, RefusesAFileThatWouldFillTheMemory) {
  const TemporaryFolder folder;
  const fs::path file = folder / "secret";
  ASSERT_TRUE(AppendLine(file, "a\n").ok());
  fs::resize_file(file, (uintmax_t{16} << 20) + 1);
  const auto refused = ReadSecretFile(file);
  EXPECT_TRUE(absl::IsInvalidArgument(refused.status()));
  EXPECT_THAT(refused.status().message(), HasSubstr("at most 16777216"));
}

TEST(SecretFileTest, KeepsAllLinesThatAreAppendedConcurrently) {
  const TemporaryFolder folder;
  std::vector<std::thread> writers;
  for (int i = 0; i < 8; ++i) {
    writers.emplace_back([&] {
      for (int k = 0; k < 10; ++k) EXPECT_TRUE(AppendLine(folder / "f", "0123456789\n").ok());
    });
  }
  for (std::thread& writer : writers) writer.join();
  EXPECT_EQ(fs::file_size(folder / "f"), 8 * 10 * 11u);
  EXPECT_THAT(folder.Names(), ::testing::ElementsAre("f"));
}

}  // namespace
}  // namespace maneuver::security::access_control_test

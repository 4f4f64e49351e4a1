// Tests handshakes that must fail, certificates that change under load, and invalid command lines.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "tests/integration/raw_call.h"
#include "tests/integration/secured_server.h"

namespace maneuver::integration::tls_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr char kHealth[] = "/grpc.health.v1.Health/Check";
constexpr char kHere[] = "IP:127.0.0.1";

grpc::StatusCode AskHealth(const std::shared_ptr<grpc::Channel>& channel) {
  return Call(channel, {.method = kHealth, .request = ""}).status.error_code();
}

class TlsTest : public ::testing::Test {
 protected:
  TestAuthority authority_{"authority"};
  TestAuthority stranger_{"stranger"};
  SecuredFolder folder_;
};

TEST_F(TlsTest, AClientWithoutTheAuthorityDoesNotConnect) {
  folder_.Install(authority_.Issue("server", kHere));
  const auto server = folder_.StartTls();
  EXPECT_EQ(AskHealth(Connect(*server, "")), grpc::StatusCode::UNAVAILABLE) << "plain text";
  EXPECT_EQ(AskHealth(Connect(*server, stranger_.certificate())), grpc::StatusCode::UNAVAILABLE)
      << "wrong authority";
  // The server still works.
  EXPECT_EQ(AskHealth(Connect(*server, authority_.certificate())), grpc::StatusCode::OK);
}

TEST_F(TlsTest, TlsToAPlainTextPortDoesNotConnect) {
  const auto server = folder_.Start();
  EXPECT_EQ(AskHealth(Connect(*server, authority_.certificate())), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(AskHealth(Connect(*server, "")), grpc::StatusCode::OK);
}

TEST_F(TlsTest, RefusesACertificateForAnotherName) {
  folder_.Install(authority_.Issue("127.0.0.1", "DNS:elsewhere.example"));
  const auto server = folder_.StartTls();
  EXPECT_EQ(AskHealth(Connect(*server, authority_.certificate())), grpc::StatusCode::UNAVAILABLE);
}

TEST_F(TlsTest, AServerWithAnExpiredCertificateWarnsAndIsNotTrusted) {
  folder_.Install(authority_.Issue("server", kHere, -3));
  const auto server = folder_.StartTls();
  EXPECT_EQ(AskHealth(Connect(*server, authority_.certificate())), grpc::StatusCode::UNAVAILABLE);
  EXPECT_THAT(folder_.log_text(),
              AllOf(HasSubstr("warning"), HasSubstr("has expired"), HasSubstr("days_left=-3")));
}

TEST_F(TlsTest, MutualTlsAdmitsOnlyCertificatesOfItsAuthority) {
  TestAuthority clients("clients");
  folder_.Install(authority_.Issue("server", kHere));
  folder_.Write("ca.crt", clients.certificate());
  folder_.Write("tokens", "planner predict cn:planner\n");
  const auto server = folder_.StartTls({"--tokens", folder_.file("tokens").string(),
                                        "--tls-client-ca", folder_.file("ca.crt").string()});
  const std::string& roots = authority_.certificate();
  EXPECT_EQ(AskHealth(Connect(*server, roots)), grpc::StatusCode::UNAVAILABLE) << "none";
  EXPECT_EQ(AskHealth(Connect(*server, roots, stranger_.Issue("planner", ""))),
            grpc::StatusCode::UNAVAILABLE)
      << "wrong authority";
  // A certificate of the authority that signed the server's own is not accepted either.
  EXPECT_EQ(AskHealth(Connect(*server, roots, authority_.Issue("planner", ""))),
            grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(AskHealth(Connect(*server, roots, clients.Issue("planner", "", -1))),
            grpc::StatusCode::UNAVAILABLE)
      << "expired";
  EXPECT_EQ(AskHealth(Connect(*server, roots, clients.Issue("planner", ""))), grpc::StatusCode::OK);
}

// Calls in two ways: over a lasting connection, and over a new one for each call.
class Callers {
 public:
  Callers(const ServerProcess& server, const std::string& roots) {
    for (const bool lasting : {true, true, false, false}) {
      threads_.emplace_back([this, &server, roots, lasting] {
        auto channel = Connect(server, roots);
        while (!stop_) {
          if (!lasting) channel = Connect(server, roots);
          Count(Ask(channel));
        }
      });
    }
  }
  ~Callers() { Stop(); }

  void Stop() {
    stop_ = true;
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
  }

  int calls() const { return calls_; }
  std::string failure() {
    const std::lock_guard lock(mutex_);
    return failure_;
  }

 private:
  static grpc::Status Ask(const std::shared_ptr<grpc::Channel>& channel) {
    v1::ListModelVersionsRequest request;
    request.set_parent("models/town");
    v1::ListModelVersionsResponse response;
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(10));
    return v1::ModelService::NewStub(channel)->ListModelVersions(&context, request, &response);
  }

  void Count(const grpc::Status& status) {
    ++calls_;
    // There is no such model.
    if (status.ok() || status.error_code() == grpc::StatusCode::NOT_FOUND) return;
    const std::lock_guard lock(mutex_);
    failure_ = status.error_message();
  }

  std::atomic<bool> stop_ = false;
  std::atomic<int> calls_ = 0;
  std::mutex mutex_;
  std::string failure_;  // guarded by mutex_
  std::vector<std::thread> threads_;
};

TEST_F(TlsTest, CertificatesAreReplacedUnderLoadWithoutALostCall) {
  TestAuthority next("next authority");
  folder_.Install(authority_.Issue("server", kHere));
  const auto server = folder_.StartTls();
  Callers callers(*server, authority_.certificate() + next.certificate());
  const auto patience = std::chrono::seconds(10);
  ASSERT_TRUE(WaitFor([&] { return callers.calls() > 50; }, patience));

  // Leaves the new certificate without its key for as long as the server needs to notice.
  const TestCertificate rotated = next.Issue("server", kHere);
  folder_.Write("server.crt", rotated.certificate);
  EXPECT_TRUE(WaitFor(
      [&] { return folder_.log_text().find("is not the key of") != std::string::npos; }, patience));
  EXPECT_EQ(AskHealth(Connect(*server, authority_.certificate())), grpc::StatusCode::OK);
  folder_.Write("server.key", rotated.key);
  const auto trusts_next = [&] {
    return AskHealth(Connect(*server, next.certificate())) == grpc::StatusCode::OK;
  };
  EXPECT_TRUE(WaitFor(trusts_next, patience));
  EXPECT_EQ(AskHealth(Connect(*server, authority_.certificate())), grpc::StatusCode::UNAVAILABLE);

  const int before = callers.calls();
  ASSERT_TRUE(WaitFor([&] { return callers.calls() > before + 50; }, patience));
  callers.Stop();
  EXPECT_EQ(callers.failure(), "");
  RecordProperty("calls", callers.calls());
}

struct Misuse {
  std::vector<std::string> flags;
  std::string says;
};

TEST_F(TlsTest, RefusesUnsafeOrContradictoryOptionsAndSaysWhatToDo) {
  const TestCertificate good = authority_.Issue("server", kHere);
  folder_.Install(good);
  folder_.Write("other.key", authority_.Issue("other", kHere).key);
  folder_.Write("text", "no certificate\n");
  folder_.Write("open.key", good.key);
  folder_.Write("open", "");
  for (const char* name : {"open.key", "open"}) {
    std::filesystem::permissions(folder_.file(name), std::filesystem::perms::others_read,
                                 std::filesystem::perm_options::add);
  }
  folder_.Write("roles", "planner fly sha256:" + std::string(64, '0') + "\n");
  const auto f = [&](const std::string& name) { return folder_.file(name).string(); };
  const std::string crt = f("server.crt");
  const std::string key = f("server.key");
  for (const Misuse& misuse : std::vector<Misuse>{
           {{"--listen", "0.0.0.0:0"}, "without TLS needs --insecure"},
           {{"--metrics-listen", "0.0.0.0:0", "--tls-certificate", crt, "--tls-key", key},
            "--metrics-listen: listening beyond loopback"},
           {{"--tls-certificate", crt}, "need each other"},
           {{"--tls-key", key}, "need each other"},
           {{"--tls-client-ca", crt}, "--tls-client-ca needs TLS"},
           {{"--tls-certificate", crt, "--tls-key", key, "--tls-client-ca", crt},
            "--tls-client-ca needs --tokens"},
           {{"--tls-certificate", f("none"), "--tls-key", key}, "cannot open none"},
           {{"--tls-certificate", crt, "--tls-key", f("none")}, "cannot open none"},
           {{"--tls-certificate", f("text"), "--tls-key", key}, "text holds no certificate"},
           {{"--tls-certificate", crt, "--tls-key", f("text")}, "text holds no private key"},
           {{"--tls-certificate", crt, "--tls-key", f("other.key")},
            "other.key is not the key of the certificate in server.crt"},
           {{"--tls-certificate", crt, "--tls-key", f("open.key")}, "chmod 600"},
           {{"--tokens", f("none")}, "--tokens: cannot open none"},
           {{"--tokens", f("open")}, "open is open to other users; close it with: chmod 600"},
           {{"--tokens", f("text")}, "--tokens: line 1: roles are predict, train and admin"},
           {{"--tokens", f("roles")}, "line 1: roles are predict, train and admin"},
       }) {
    SCOPED_TRACE(::testing::PrintToString(misuse.flags));
    // A server that starts by mistake would serve for ever.
    std::vector<std::string> command = {
        "/usr/bin/timeout", "5",           MANEUVERD,          "--data-dir", f("refused"),
        "--listen",         "127.0.0.1:0", "--metrics-listen", "none"};
    for (const std::string& flag : misuse.flags) {
      const auto given = std::ranges::find(command, flag);
      if (given != command.end() && flag.starts_with("--")) command.erase(given, given + 2);
      command.push_back(flag);
    }
    std::string output;
    const int status = integration::Run(command, &output);
    EXPECT_TRUE(status == 1 || status == 2) << status;
    EXPECT_THAT(output, HasSubstr(misuse.says));
    EXPECT_FALSE(std::filesystem::exists(f("refused"))) << "refused before anything is touched";
  }
}

TEST_F(TlsTest, TheCommandUsesTlsAndNeverSendsItsTokenInPlainText) {
  folder_.Install(authority_.Issue("server", kHere));
  folder_.Write("ca.crt", authority_.certificate());
  folder_.Write("token", folder_.CreateToken("researcher", "train") + "\n");
  const auto server = folder_.StartTls({"--tokens", folder_.file("tokens").string()});
  const auto f = [&](const char* name) { return folder_.file(name).string(); };
  std::string output;
  EXPECT_EQ(
      RunManeuver(*server, {"--tls-ca", f("ca.crt"), "--token-file", f("token"), "job", "list"},
                  &output),
      0)
      << output;
  EXPECT_EQ(RunManeuver(*server, {"--tls-ca", f("ca.crt"), "job", "list"}, &output), 1);
  EXPECT_THAT(output, HasSubstr("--token-file"));
  EXPECT_EQ(RunManeuver(*server, {"job", "list"}, &output), 1);
  EXPECT_THAT(output, HasSubstr("--tls"));
  // Every kind of call carries the token.
  EXPECT_EQ(integration::Run({MANEUVER, "synthesize", f("town"), "--recordings", "1"}, &output), 0)
      << output;
  const std::vector<std::string> known = {"--tls-ca", f("ca.crt"), "--token-file", f("token")};
  const auto as_researcher = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), known.begin(), known.end());
    return RunManeuver(*server, arguments, &output);
  };
  EXPECT_EQ(as_researcher({"dataset", "upload", f("town"), "town"}), 0) << output;
  EXPECT_EQ(as_researcher({"job", "watch", "none"}), 1);
  EXPECT_THAT(output, HasSubstr("jobs/none"));
  EXPECT_EQ(as_researcher({"health"}), 0) << output;
  // Plain text beyond this machine: nothing is sent at all.
  EXPECT_EQ(integration::Run(
                {MANEUVER, "--server", "192.0.2.1:8470", "--token-file", f("token"), "job", "list"},
                &output),
            2);
  EXPECT_THAT(output, HasSubstr("in plain text"));
  // The token and the authority may also come from the environment.
  const std::string script = "MANEUVER_TOKEN=$(cat " + f("token") +
                             ") MANEUVER_TLS_CA=" + f("ca.crt") + " " + MANEUVER + " --server " +
                             server->address() + " job list";
  EXPECT_EQ(integration::Run({"/bin/sh", "-c", script}, &output), 0) << output;
}

TEST_F(TlsTest, LimitsTheCallsOfAConnectionAndClosesItWhenIdle) {
  const auto server = folder_.Start({"--max-streams", "2", "--max-connection-idle", "1"});
  const auto channel = Connect(*server, "");
  const auto stub = v1::PredictionService::NewStub(channel);
  {
    grpc::ClientContext first;
    grpc::ClientContext second;
    const auto one = stub->StreamPredict(&first);
    const auto two = stub->StreamPredict(&second);
    v1::StreamPredictResponse response;
    ASSERT_TRUE(one->Write({}) && one->Read(&response));
    ASSERT_TRUE(two->Write({}) && two->Read(&response));
    v1::PredictResponse answer;
    grpc::ClientContext third;
    third.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(300));
    EXPECT_EQ(stub->Predict(&third, {}, &answer).error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
    one->WritesDone();
    ASSERT_TRUE(one->Finish().ok());
    grpc::ClientContext fourth;
    EXPECT_EQ(stub->Predict(&fourth, {}, &answer).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    two->WritesDone();
    two->Finish();
  }
  EXPECT_TRUE(WaitFor([&] { return channel->GetState(false) != GRPC_CHANNEL_READY; },
                      std::chrono::seconds(10)));
}

}  // namespace
}  // namespace maneuver::integration::tls_test

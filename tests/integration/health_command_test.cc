// Tests how probes read a server's health: by maneuverd health, for machines and containers that
// contain only the server, and by its pages over HTTP.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <cstdlib>
#include <string>
#include <vector>

#include "tests/integration/metrics_page.h"
#include "tests/integration/secured_server.h"

namespace maneuver::integration::health_command_test {
namespace {

using ::testing::HasSubstr;

constexpr int kServing = 0;
constexpr int kNotServing = 1;
constexpr int kCannotAsk = 2;

std::string PortOf(const std::string& address) { return address.substr(address.rfind(':') + 1); }

class HealthCommandTest : public ::testing::Test {
 protected:
  int Probe(const std::string& listen, std::vector<std::string> arguments = {}) {
    std::vector<std::string> command = {MANEUVERD, "health"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    command.insert(command.end(),
                   {"--data-dir", folder_.file("data").string(), "--listen", listen});
    return maneuver::integration::Run(command, &output_);
  }

  std::vector<std::string> Tls() const {
    return {"--tls-certificate", folder_.file("server.crt").string(), "--tls-key",
            folder_.file("server.key").string()};
  }

  SecuredFolder folder_;
  std::string output_;
};

TEST_F(HealthCommandTest, TellsWhetherTheServerAndEachServiceServe) {
  const auto server = folder_.Start();
  EXPECT_EQ(Probe(server->address()), kServing);
  EXPECT_EQ(output_, "SERVING\n");
  EXPECT_EQ(Probe(server->address(), {"maneuver.v1.TrainingService"}), kServing);
  // It has no model.
  EXPECT_EQ(Probe(server->address(), {"maneuver.v1.PredictionService"}), kNotServing);
  EXPECT_THAT(output_, HasSubstr("PredictionService is not ready to serve"));
  EXPECT_EQ(Probe(server->address(), {"no.such.Service"}), kNotServing);
}

TEST_F(HealthCommandTest, NeedsNoDataFolder) {
  const auto server = folder_.Start();
  EXPECT_EQ(integration::Run({MANEUVERD, "health", "--listen", server->address()}, &output_),
            kServing)
      << output_;
}

TEST_F(HealthCommandTest, HealthPagesAgreeWithTheCommand) {
  const auto server = folder_.Start({"--shutdown-delay", "60"});
  EXPECT_THAT(HttpGet(*server, "/healthz"), HasSubstr(" 200 OK\r\n"));
  EXPECT_THAT(HttpGet(*server, "/readyz?service="), HasSubstr(" 200 OK\r\n"));
  EXPECT_THAT(HttpGet(*server, "/readyz?service=maneuver.v1.TrainingService"),
              HasSubstr(" 200 OK\r\n"));
  EXPECT_THAT(HttpGet(*server, "/readyz?service=no.such.Service"), HasSubstr(" 404 "));
  // It has no model.
  EXPECT_THAT(HttpGet(*server, "/readyz"), HasSubstr(" 503 "));
  // A draining server is alive but not ready.
  ASSERT_EQ(kill(server->pid(), SIGTERM), 0);
  EXPECT_TRUE(WaitFor(
      [&] { return HttpGet(*server, "/readyz?service=").find(" 503 ") != std::string::npos; },
      std::chrono::seconds(10)));
  EXPECT_THAT(HttpGet(*server, "/healthz"), HasSubstr(" 200 OK\r\n"));
  server->Kill();
}

TEST_F(HealthCommandTest, AsksAServerThatListensEverywhereOnTheLocalHost) {
  const auto server = folder_.Start();
  EXPECT_EQ(Probe("0.0.0.0:" + PortOf(server->address()), {"--insecure"}), kServing);
}

TEST_F(HealthCommandTest, ReadsTheServersFileAndRefusesWhatTheServerWouldRefuse) {
  const auto server = folder_.Start();
  folder_.Write("maneuverd.conf", "listen = " + server->address() + "\ndata-dir = \"" +
                                      folder_.file("data").string() + "\"\n");
  EXPECT_EQ(
      maneuver::integration::Run(
          {MANEUVERD, "health", "--config", folder_.file("maneuverd.conf").string()}, &output_),
      kServing);
  folder_.Write("maneuverd.conf", "lissen = " + server->address() + "\n");
  EXPECT_EQ(
      maneuver::integration::Run(
          {MANEUVERD, "health", "--config", folder_.file("maneuverd.conf").string()}, &output_),
      kCannotAsk);
  EXPECT_EQ(Probe("127.0.0.1:0"), kCannotAsk);
}

TEST_F(HealthCommandTest, TakesTheServiceBeforeOrAfterTheOptions) {
  const auto server = folder_.Start();
  const std::string data_dir = folder_.file("data").string();
  const std::string address = server->address();
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{MANEUVERD, "health", "--data-dir", data_dir, "--listen", address,
                                 "maneuver.v1.PredictionService"},
        {MANEUVERD, "health", "maneuver.v1.PredictionService", "--data-dir", data_dir, "--listen",
         address},
        {MANEUVERD, "health", "--data-dir=" + data_dir, "--listen=" + address,
         "maneuver.v1.PredictionService"}}) {
    EXPECT_EQ(maneuver::integration::Run(command, &output_), kNotServing) << output_;
    EXPECT_THAT(output_, HasSubstr("PredictionService is not ready to serve"));
  }
}

TEST_F(HealthCommandTest, FailsIfTheServerIsGone) {
  auto server = folder_.Start();
  const std::string address = server->address();
  server->Terminate();
  EXPECT_EQ(Probe(address), kNotServing);
}

TEST_F(HealthCommandTest, AsksOverTlsWithoutCheckingTheCertificatesName) {
  TestAuthority authority("authority");
  folder_.Install(authority.Issue("server", "DNS:elsewhere.example"));
  const auto server = folder_.StartTls();
  EXPECT_EQ(Probe(server->address(), Tls()), kServing) << output_;
  EXPECT_EQ(Probe(server->address()), kNotServing) << "plain text";
}

TEST_F(HealthCommandTest, SendsAClientCertificateIfTheServerRequiresOne) {
  TestAuthority authority("authority");
  TestAuthority clients("clients");
  folder_.Install(authority.Issue("server", "IP:127.0.0.1"));
  folder_.Write("ca.crt", clients.certificate());
  folder_.Write("tokens", "probe predict cn:probe\n");
  const auto probe = clients.Issue("probe", "");
  folder_.Write("probe.crt", probe.certificate);
  folder_.Write("probe.key", probe.key);
  const std::vector<std::string> mutual = {"--tokens", folder_.file("tokens").string(),
                                           "--tls-client-ca", folder_.file("ca.crt").string()};
  const auto server = folder_.StartTls(mutual);
  EXPECT_EQ(Probe(server->address(), Tls()), kNotServing);
  setenv("MANEUVER_TLS_CERTIFICATE", folder_.file("probe.crt").c_str(), 1);
  setenv("MANEUVER_TLS_KEY", folder_.file("probe.key").c_str(), 1);
  EXPECT_EQ(Probe(server->address(), Tls()), kServing) << output_;
  unsetenv("MANEUVER_TLS_CERTIFICATE");
  unsetenv("MANEUVER_TLS_KEY");
}

}  // namespace
}  // namespace maneuver::integration::health_command_test

#include "client/server_address.h"

#include <gtest/gtest.h>

#include "client/client.h"
#include "client/credentials.h"
#include "tests/unit/client/test_server.h"

namespace maneuver::client::server_address_test {
namespace {

TEST(ServerAddressTest, PassesASingleServerUnchanged) {
  for (const char* address : {"127.0.0.1:8470", "planner.example:8470", "unix:/run/maneuverd"}) {
    const auto parsed = ParseServerAddress(address);
    ASSERT_TRUE(parsed.ok()) << parsed.status();
    EXPECT_EQ(parsed->target, address);
    EXPECT_FALSE(parsed->several);
  }
}

TEST(ServerAddressTest, AddsTheDefaultPort) {
  for (const auto& [address, target] : std::vector<std::pair<std::string, std::string>>{
           {"localhost", "localhost:8470"},
           {"10.0.0.1", "10.0.0.1:8470"},
           {"[::1]", "[::1]:8470"},
           {"::1", "[::1]:8470"},
           {"[::1]:9", "[::1]:9"},
           {"dns:///maneuverd", "dns:///maneuverd:8470"}}) {
    EXPECT_EQ(ParseServerAddress(address)->target, target);
  }
  EXPECT_TRUE(IsLocal("localhost"));
  EXPECT_TRUE(IsLocal("::1"));
  EXPECT_FALSE(IsLocal("planner.example"));
}

TEST(ServerAddressTest, AcceptsAListOfAddressesOrANameForSeveralServers) {
  const auto list = ParseServerAddress("10.0.0.1:8470,10.0.0.2:8471");
  ASSERT_TRUE(list.ok());
  EXPECT_EQ(list->target, "ipv4:10.0.0.1:8470,10.0.0.2:8471");
  EXPECT_TRUE(list->several);
  EXPECT_EQ(ParseServerAddress("[fd00::1]:8470,[::1]:8470")->target,
            "ipv6:[fd00::1]:8470,[::1]:8470");
  const auto name = ParseServerAddress("dns:///maneuverd:8470");
  ASSERT_TRUE(name.ok());
  EXPECT_EQ(name->target, "dns:///maneuverd:8470");
  EXPECT_TRUE(name->several);
}

TEST(ServerAddressTest, RefusesAListThatContainsANonAddress) {
  for (const char* address :
       {"", "a:1,b:1", "10.0.0.1:8470,", "10.0.0.1:8470,[::1]:8470", "10.0.0.1,10.0.0.2"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(ParseServerAddress(address).status())) << address;
    EXPECT_TRUE(absl::IsInvalidArgument(Client::Connect({.address = address}).status()));
  }
}

TEST(ServerAddressTest, SaysWhatIsWrongWithAnAddress) {
  for (const auto& [address, why] : std::vector<std::pair<std::string, std::string>>{
           {"http://planner:8470", "name the server as HOST:PORT, without http://"},
           {"https://planner", "without https://"},
           {"dns:///", "a name is missing, as in dns:///NAME:PORT"},
           {"dns:///:8470", "a name is missing"},
           {"10.0.0.1:8470,10.0.0.2", "needs its port, and 10.0.0.2 has none"},
           {"[fd00::1],[::1]", "[fd00::1] has none"}}) {
    const absl::Status status = ParseServerAddress(address).status();
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << address;
    EXPECT_NE(status.message().find(why), std::string::npos) << status;
  }
}

TEST(ServerAddressTest, RefusesAPortThatThereIsNot) {
  for (const char* address :
       {"planner:99999", "planner:0", "[::1]:65536", "dns:///planner:4294967297",
        "10.0.0.1:8470,10.0.0.2:70000", "planner:99999999999999999999"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(ParseServerAddress(address).status())) << address;
  }
  for (const char* address :
       {"planner:1", "planner:65535", "unix:99999", "unix:/run/a:0", "unix-abstract:0"}) {
    EXPECT_TRUE(ParseServerAddress(address).ok()) << address;
  }
}

TEST(ServerAddressTest, IsLocalOnlyIfAllServersAreLocal) {
  EXPECT_TRUE(IsLocal("127.0.0.1:1,127.0.0.2:1"));
  EXPECT_TRUE(IsLocal("dns:///localhost:1"));
  EXPECT_FALSE(IsLocal("127.0.0.1:1,10.0.0.1:1"));
  EXPECT_FALSE(IsLocal("dns:///maneuverd:1"));
  EXPECT_TRUE(absl::IsFailedPrecondition(
      Client::Connect({.address = "127.0.0.1:1,10.0.0.1:1", .token = "secret"}).status()));
}

// A server that answers predictions with its name, once it is marked ready.
class NamedServer {
 public:
  explicit NamedServer(const std::string& name) {
    server.on_predict = [name](auto*, const auto&, v1::PredictResponse* response) {
      response->set_model_version(name);
      return grpc::Status::OK;
    };
  }
  TestServer server{0, /*health=*/true};
};

TEST(SeveralServersTest, SendsPredictionsInTurnToReadyServers) {
  NamedServer a("a");
  NamedServer b("b");
  NamedServer c("c");
  a.server.SetReady(true);
  b.server.SetReady(true);
  const auto client = *Client::Connect(
      {.address = a.server.address() + "," + b.server.address() + "," + c.server.address()});
  const auto ask = [&client] { return client->Predict({})->model_version(); };
  // Until both are connected, the first one gets all calls. Whenever a server's state has arrived, gRPC
  // begins anew with any of them, so one may get two calls in a row even later.
  const absl::Time give_up = absl::Now() + absl::Seconds(20);
  std::string before;
  int in_turn = 0;
  while (in_turn < 30 && absl::Now() < give_up) {
    const std::string now = ask();
    ASSERT_NE(now, "c");
    in_turn = now == before ? 0 : in_turn + 1;
    before = now;
  }
  EXPECT_EQ(in_turn, 30);
  // A draining server gets no calls, at the latest when its health has arrived here.
  b.server.SetReady(false);
  int in_a_row = 0;
  while (in_a_row < 10 && absl::Now() < give_up) in_a_row = ask() == "a" ? in_a_row + 1 : 0;
  EXPECT_EQ(in_a_row, 10);
}

}  // namespace
}  // namespace maneuver::client::server_address_test

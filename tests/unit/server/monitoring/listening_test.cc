#include "server/monitoring/listening.h"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <string>

namespace maneuver::monitoring::listening_test {
namespace {

TEST(WhyNotListeningTest, TellsATakenPortFromAnAddressOfAnotherMachine) {
  const int taken = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  ASSERT_EQ(bind(taken, reinterpret_cast<sockaddr*>(&address), size), 0);
  ASSERT_EQ(listen(taken, 1), 0);
  ASSERT_EQ(getsockname(taken, reinterpret_cast<sockaddr*>(&address), &size), 0);
  const std::string port = std::to_string(ntohs(address.sin_port));
  EXPECT_EQ(WhyNotListening("127.0.0.1:" + port), "another program listens on this port");
  close(taken);
  EXPECT_EQ(WhyNotListening("127.0.0.1:" + port), "the log says why");  // it is free by now
  // RFC 5737: no machine has it.
  EXPECT_EQ(WhyNotListening("192.0.2.1:" + port), "the address is not one of this machine's");
}

}  // namespace
}  // namespace maneuver::monitoring::listening_test

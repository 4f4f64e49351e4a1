#include "tests/integration/metrics_page.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

namespace maneuver::testing {

std::string MetricsPage(const ServerProcess& server) {
  const std::string& address = server.metrics_address();
  const int descriptor = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in peer{};
  peer.sin_family = AF_INET;
  peer.sin_port = htons(static_cast<uint16_t>(std::stoi(address.substr(address.rfind(':') + 1))));
  peer.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(connect(descriptor, reinterpret_cast<const sockaddr*>(&peer), sizeof peer), 0);
  const std::string request = "GET /metrics HTTP/1.0\r\n\r\n";
  EXPECT_EQ(write(descriptor, request.data(), request.size()),
            static_cast<ssize_t>(request.size()));
  std::string answer;
  char buffer[4096];
  for (ssize_t count = 0; (count = read(descriptor, buffer, sizeof buffer)) > 0;) {
    answer.append(buffer, static_cast<size_t>(count));
  }
  close(descriptor);
  return answer.substr(answer.find("\r\n\r\n") + 4);
}

double ValueOf(const std::string& page, const std::string& series) {
  const size_t start = page.find("\n" + series + " ");
  if (start == std::string::npos) return -1.0;
  return std::stod(page.substr(start + series.size() + 2));
}

}  // namespace maneuver::testing

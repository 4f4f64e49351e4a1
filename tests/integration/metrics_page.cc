#include "tests/integration/metrics_page.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>

namespace maneuver::integration {
namespace {

int RunShell(const std::string& script, std::string* output) {
  return Run({"/bin/sh", "-c", script}, output);
}

std::string ReadText(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

}  // namespace

std::string HttpGet(const ServerProcess& server, const std::string& path) {
  const std::string& address = server.metrics_address();
  const int descriptor = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in peer{};
  peer.sin_family = AF_INET;
  peer.sin_port = htons(static_cast<uint16_t>(std::stoi(address.substr(address.rfind(':') + 1))));
  peer.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(connect(descriptor, reinterpret_cast<const sockaddr*>(&peer), sizeof peer), 0);
  const std::string request = "GET " + path + " HTTP/1.0\r\n\r\n";
  EXPECT_EQ(write(descriptor, request.data(), request.size()),
            static_cast<ssize_t>(request.size()));
  std::string answer;
  char buffer[4096];
  for (ssize_t count = 0; (count = read(descriptor, buffer, sizeof buffer)) > 0;) {
    answer.append(buffer, static_cast<size_t>(count));
  }
  close(descriptor);
  return answer;
}

std::string MetricsPage(const ServerProcess& server) {
  const std::string answer = HttpGet(server, "/metrics");
  return answer.substr(answer.find("\r\n\r\n") + 4);
}

double ValueOf(const std::string& page, const std::string& series) {
  const size_t start = page.find("\n" + series + " ");
  if (start == std::string::npos) return -1.0;
  return std::stod(page.substr(start + series.size() + 2));
}

std::string ShapeOf(const std::string& page, const std::string& prefix) {
  struct Family {
    std::string comments;
    std::set<std::string> series;
  };
  std::map<std::string, Family> families;
  Family* family = nullptr;
  std::istringstream lines(page);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("#")) {
      family = &families[line.substr(7, line.find(' ', 7) - 7)];  // "# HELP name", "# TYPE name"
      family->comments += line + "\n";
    } else if (!line.empty() && family != nullptr) {
      line = line.substr(0, line.rfind(' '));
      family->series.insert(std::regex_replace(
          line, std::regex("(le|quantile|method|model|speed|version)=\"[^\"]*\""), "$1=*"));
    }
  }
  std::string shape;
  for (const auto& [name, each] : families) {
    if (!name.starts_with(prefix)) continue;
    shape += each.comments;
    for (const std::string& series : each.series) shape += series + "\n";
  }
  return shape;
}

void ExpectShape(const std::string& shape, const std::filesystem::path& golden,
                 const std::filesystem::path& seen) {
  if (shape == ReadText(golden)) return;
  std::ofstream(seen) << shape;
  std::string difference;
  RunShell("diff -U0 '" + golden.string() + "' '" + seen.string() + "'", &difference);
  ADD_FAILURE() << "If this is what is meant: cp " << seen << " " << golden << "\n" << difference;
}

bool HasPromtool() {
  std::string output;
  return RunShell("command -v promtool", &output) == 0;
}

void ExpectPromtoolIsContent(const std::string& page, const std::filesystem::path& file) {
  std::ofstream(file) << page;
  std::string output;
  EXPECT_EQ(RunShell("promtool check metrics <" + file.string(), &output), 0) << output;
  EXPECT_EQ(output, "");
}

}  // namespace maneuver::integration

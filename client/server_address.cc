#include "client/server_address.h"

#include <arpa/inet.h>

#include <algorithm>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

namespace maneuver::client {
namespace {

constexpr std::string_view kDns = "dns:///";

// Returns AF_INET for "127.0.0.1:8470", AF_INET6 for "[::1]:8470", and 0 for anything else.
int FamilyOf(const std::string& address) {
  const size_t colon = address.rfind(':');
  if (colon == std::string::npos || colon + 1 == address.size()) return 0;
  std::string host = address.substr(0, colon);
  in_addr v4{};
  if (inet_pton(AF_INET, host.c_str(), &v4) == 1) return AF_INET;
  if (host.size() < 3 || host.front() != '[' || host.back() != ']') return 0;
  host = host.substr(1, host.size() - 2);
  in6_addr v6{};
  return inet_pton(AF_INET6, host.c_str(), &v6) == 1 ? AF_INET6 : 0;
}

// Returns whether an address is an IP address without a port.
bool LacksPort(const std::string& address) {
  in_addr v4{};
  in6_addr v6{};
  return inet_pton(AF_INET, address.c_str(), &v4) == 1 ||
         inet_pton(AF_INET6, address.c_str(), &v6) == 1 ||
         (address.starts_with('[') && address.ends_with(']'));
}

// Adds kDefaultPort to "localhost", "10.0.0.1", "[::1]" and "::1". Leaves anything else unchanged,
// such as the path of a Unix socket.
std::string WithPort(const std::string& address) {
  in6_addr v6{};
  if (inet_pton(AF_INET6, address.c_str(), &v6) == 1) {
    return absl::StrCat("[", address, "]:", kDefaultPort);
  }
  const bool bracketed = address.starts_with('[') && address.ends_with(']');
  if (!bracketed && address.find(':') != std::string::npos) return address;
  return absl::StrCat(address, ":", kDefaultPort);
}

// gRPC would connect to the port modulo 65536.
absl::Status CheckPort(const std::string& address) {
  constexpr int kMostPort = 65535;
  if (address.starts_with("unix:") || address.starts_with("unix-abstract:")) {
    return absl::OkStatus();
  }
  const std::string_view port = std::string_view(address).substr(address.rfind(':') + 1);
  const bool is_number = !port.empty() && port.find_first_not_of("0123456789") == port.npos;
  int number = 0;
  if (!is_number ||
      (absl::SimpleAtoi(std::string(port), &number) && number > 0 && number <= kMostPort)) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      absl::StrCat(address, ": the port is not from 1 to ", kMostPort));
}

}  // namespace

absl::StatusOr<ServerAddress> ParseServerAddress(std::string_view address) {
  if (address.empty()) {
    return absl::InvalidArgumentError("address is empty; name the server as HOST:PORT");
  }
  for (const std::string_view scheme : {"http://", "https://", "grpc://", "grpcs://"}) {
    if (!address.starts_with(scheme)) continue;
    return absl::InvalidArgumentError(absl::StrCat(
        std::string(address), ": name the server as HOST:PORT, without ", std::string(scheme)));
  }
  if (address.starts_with(kDns)) {
    if (address.size() == kDns.size() || address[kDns.size()] == ':') {
      return absl::InvalidArgumentError(
          absl::StrCat(std::string(address), ": a name is missing, as in dns:///NAME:PORT"));
    }
    const std::string name = WithPort(std::string(address.substr(kDns.size())));
    if (absl::Status status = CheckPort(name); !status.ok()) return status;
    return ServerAddress{absl::StrCat(std::string(kDns), name), true, {name}};
  }
  const std::vector<std::string> all = absl::StrSplit(std::string(address), ',');
  if (all.size() == 1) {
    const std::string one = WithPort(all.front());
    if (absl::Status status = CheckPort(one); !status.ok()) return status;
    return ServerAddress{one, false, {one}};
  }
  if (const auto portless = std::ranges::find_if(all, LacksPort); portless != all.end()) {
    return absl::InvalidArgumentError(absl::StrCat(std::string(address),
                                                   ": each of several servers needs its port, and ",
                                                   *portless, " has none"));
  }
  const int family = FamilyOf(all.front());
  const bool alike = std::ranges::all_of(
      all, [family](const std::string& one) { return FamilyOf(one) == family; });
  if (family == 0 || !alike) {
    return absl::InvalidArgumentError(
        absl::StrCat(std::string(address),
                     ": several servers are named by their addresses, all IPv4 (10.0.0.1:8470,"
                     "10.0.0.2:8470) or all IPv6 ([fd00::1]:8470,...), or by a name that stands "
                     "for all of them: dns:///NAME:PORT"));
  }
  for (const std::string& one : all) {
    if (absl::Status status = CheckPort(one); !status.ok()) return status;
  }
  return ServerAddress{absl::StrCat(family == AF_INET ? "ipv4:" : "ipv6:", absl::StrJoin(all, ",")),
                       true, all};
}

}  // namespace maneuver::client

// Private to the library: names for requests that are sent again.

#ifndef MANEUVER_CLIENT_REQUEST_ID_H_
#define MANEUVER_CLIENT_REQUEST_ID_H_

#include <array>
#include <cstdio>
#include <random>
#include <string>

namespace maneuver::client {

// Returns 128 random bits, hexadecimal.
inline std::string NewRequestId() {
  std::random_device device;
  std::string id;
  for (int i = 0; i < 4; ++i) {
    std::array<char, 9> word{};
    std::snprintf(word.data(), word.size(), "%08x", device());
    id += word.data();
  }
  return id;
}

// Gives a request an id, unless it has one.
template <typename Request>
Request WithRequestId(Request request) {
  if (request.request_id().empty()) request.set_request_id(NewRequestId());
  return request;
}

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_REQUEST_ID_H_

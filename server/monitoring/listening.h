// Why a server cannot listen on an address.

#ifndef MANEUVER_SERVER_MONITORING_LISTENING_H_
#define MANEUVER_SERVER_MONITORING_LISTENING_H_

#include <string>

namespace maneuver::monitoring {

// Returns why this process cannot listen on HOST:PORT or [IPV6]:PORT, in words that complete "cannot
// listen on it: ...". Learns it by trying, since libraries that listen keep it to themselves.
std::string WhyNotListening(const std::string& address);

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_LISTENING_H_

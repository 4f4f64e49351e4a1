// Why a server cannot listen on an address.

#ifndef MANEUVER_SERVER_MONITORING_LISTENING_H_
#define MANEUVER_SERVER_MONITORING_LISTENING_H_

#include <string>

namespace maneuver::monitoring {

// Returns why this process cannot listen on HOST:PORT or [IPV6]:PORT, in words that complete
// "cannot listen on it: ...". Tries it, because the libraries that serve a port do not report the
// reason.
std::string WhyNotListening(const std::string& address);

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_LISTENING_H_

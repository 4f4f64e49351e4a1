#include "server/monitoring/metrics_page_server.h"

#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

namespace maneuver::monitoring {
namespace {

// Whoever connects and says nothing holds a thread until its time is up: what is left of them
// answers others meanwhile, and after a second all do.
constexpr char kThreads[] = "8";
constexpr char kRequestTimeout[] = "1000";  // milliseconds
constexpr std::chrono::milliseconds kBetweenKnocks{5};

// HOST of HOST:PORT, without brackets.
std::string HostOf(const std::string& address) {
  std::string host = address.substr(0, address.rfind(':'));
  if (host.size() > 1 && host.front() == '[') host = host.substr(1, host.size() - 2);
  return host;
}

// Connects and hangs up. Whoever listens everywhere (0.0.0.0, ::) is reached here.
void Knock(const std::string& host, const std::string& port) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_NUMERICSERV;
  addrinfo* found = nullptr;
  if (getaddrinfo(host.c_str(), port.c_str(), &hints, &found) != 0) return;
  const int descriptor = socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (descriptor >= 0) {
    // Refused once nobody listens: nothing is left to be done then.
    [[maybe_unused]] const int ignored = connect(descriptor, found->ai_addr, found->ai_addrlen);
    close(descriptor);
  }
  freeaddrinfo(found);
}

}  // namespace

MetricsPageServer::MetricsPageServer(const std::string& address)
    : host_(HostOf(address)),
      exposer_(std::make_unique<prometheus::Exposer>(
          std::vector<std::string>{"listening_ports", address, "num_threads", kThreads,
                                   "request_timeout_ms", kRequestTimeout})),
      port_(exposer_->GetListeningPorts().at(0)) {}

MetricsPageServer::~MetricsPageServer() {
  std::atomic<bool> ended = false;
  // A connection is what civetweb wakes up by; those that come before it is asked to end are in
  // vain.
  std::thread knocking([this, &ended] {
    while (!ended) {
      Knock(host_, std::to_string(port_));
      std::this_thread::sleep_for(kBetweenKnocks);
    }
  });
  exposer_.reset();
  ended = true;
  knocking.join();
}

void MetricsPageServer::Show(const std::weak_ptr<prometheus::Collectable>& collectable) {
  exposer_->RegisterCollectable(collectable);
}

}  // namespace maneuver::monitoring

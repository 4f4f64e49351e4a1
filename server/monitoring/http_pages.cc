#include "server/monitoring/http_pages.h"

#include <civetweb.h>
#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/monitoring/listening.h"

namespace maneuver::monitoring {
namespace {

// Whoever connects and says nothing holds a thread until its time is up. The others answer
// meanwhile. A thread that waits costs some 30 kB.
constexpr char kThreads[] = "256";
constexpr char kRequestTimeout[] = "500";  // milliseconds
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

// Civetweb's handler of one page, which is `closure`.
int Answer(mg_connection* connection, void* closure) {
  const auto& page = *static_cast<const HttpPage*>(closure);
  const mg_request_info& request = *mg_get_request_info(connection);
  const std::string_view method = request.request_method;
  HttpAnswer answer{405, "only GET and HEAD\n"};
  if (method == "GET" || method == "HEAD") {
    answer = page.make(request.query_string == nullptr ? "" : request.query_string);
  }
  const std::string head = absl::StrCat(
      "HTTP/1.1 ", answer.status, " ", mg_get_response_code_text(connection, answer.status),
      "\r\nContent-Type: ", page.content_type, "\r\nContent-Length: ", answer.text.size(),
      "\r\nCache-Control: no-store\r\nConnection: close\r\n\r\n");
  mg_write(connection, head.data(), head.size());
  if (method != "HEAD") mg_write(connection, answer.text.data(), answer.text.size());
  return answer.status;
}

class CivetPages final : public HttpPages {
 public:
  CivetPages(std::string host, std::vector<HttpPage> pages)
      : host_(std::move(host)), pages_(std::move(pages)) {}

  absl::Status Start(const std::string& address) {
    if (address.starts_with('[') && mg_check_feature(MG_FEATURES_IPV6) == 0) {
      return absl::InvalidArgumentError(
          absl::StrCat("cannot serve metrics and health on ", address,
                       ": they have IPv4 addresses only; name one, such as 127.0.0.1:9470"));
    }
    std::array<const char*, 7> options = {
        "listening_ports",    address.c_str(), "num_threads", kThreads,
        "request_timeout_ms", kRequestTimeout, nullptr};
    const mg_callbacks callbacks{};
    context_ = mg_start(&callbacks, nullptr, options.data());
    mg_server_port listened{};
    if (context_ == nullptr || mg_get_server_ports(context_, 1, &listened) < 1) {
      return absl::UnavailableError(absl::StrCat("cannot serve metrics and health on ", address,
                                                 ": ", WhyNotListening(address)));
    }
    port_ = listened.port;
    for (HttpPage& page : pages_) {
      // '$' is the end: what is under a page is not the page.
      mg_set_request_handler(context_, (page.path + "$").c_str(), Answer, &page);
    }
    return absl::OkStatus();
  }

  ~CivetPages() override {
    if (context_ == nullptr) return;
    std::atomic<bool> ended = false;
    // A connection is what civetweb wakes up by; those that come before it is asked to end are in
    // vain.
    std::thread knocking([this, &ended] {
      while (!ended) {
        Knock(host_, std::to_string(port_));
        std::this_thread::sleep_for(kBetweenKnocks);
      }
    });
    mg_stop(context_);
    ended = true;
    knocking.join();
  }

  int port() const override { return port_; }

 private:
  const std::string host_;
  std::vector<HttpPage> pages_;  // civetweb holds their addresses
  mg_context* context_ = nullptr;
  int port_ = 0;
};

}  // namespace

absl::StatusOr<std::unique_ptr<HttpPages>> HttpPages::Serve(const std::string& address,
                                                            std::vector<HttpPage> pages) {
  auto served = std::make_unique<CivetPages>(HostOf(address), std::move(pages));
  if (const auto status = served->Start(address); !status.ok()) return status;
  return served;
}

}  // namespace maneuver::monitoring

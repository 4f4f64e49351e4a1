#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "client/load/metrics_page.h"

namespace maneuver::load {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr size_t kMostBytes = size_t{16} << 20;

class Socket {
 public:
  explicit Socket(int fd) : fd_(fd) {}
  ~Socket() {
    if (fd_ >= 0) close(fd_);
  }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;

  int fd() const { return fd_; }

  // Returns whether it can be read or written before `deadline`.
  bool Ready(int16_t events, steady_clock::time_point deadline) const {
    const auto left = std::chrono::ceil<milliseconds>(deadline - steady_clock::now());
    pollfd waiting = {.fd = fd_, .events = events, .revents = 0};
    return left.count() > 0 && poll(&waiting, 1, static_cast<int>(left.count())) == 1;
  }

 private:
  const int fd_;
};

struct Address {
  std::string host;
  std::string port;
  std::string path;
};

absl::StatusOr<Address> ParseUrl(const std::string& url) {
  absl::string_view rest = url;
  const bool has_scheme = absl::ConsumePrefix(&rest, "http://");
  const size_t slash = rest.find('/');
  const absl::string_view authority = rest.substr(0, slash);
  Address address;
  address.path = slash == absl::string_view::npos ? "/metrics" : std::string(rest.substr(slash));
  const size_t colon = authority.rfind(':');
  const bool bracketed = !authority.empty() && authority.back() == ']';
  const bool has_port = colon != absl::string_view::npos && !bracketed;
  absl::string_view host = authority.substr(0, has_port ? colon : authority.size());
  if (absl::ConsumePrefix(&host, "[")) absl::ConsumeSuffix(&host, "]");
  address.host = std::string(host);
  address.port = has_port ? std::string(authority.substr(colon + 1)) : "80";
  if (address.host.empty() || address.port.empty() || (!has_scheme && !has_port)) {
    return absl::InvalidArgumentError(absl::StrCat(
        url, " is no address of a metrics page, such as http://127.0.0.1:9470/metrics"));
  }
  return address;
}

absl::Status NotThere(const std::string& url, const char* why) {
  return absl::UnavailableError(absl::StrCat("no metrics at ", url, ": ", why));
}

// Sends `text`, then reads until the other side closes.
absl::StatusOr<std::string> Exchange(const Socket& socket, const std::string& text,
                                     steady_clock::time_point deadline) {
  // A request is far smaller than any socket's buffer.
  if (!socket.Ready(POLLOUT, deadline) || send(socket.fd(), text.data(), text.size(),
                                               MSG_NOSIGNAL) != static_cast<ssize_t>(text.size())) {
    return absl::UnavailableError("it takes no request");
  }
  std::string answer;
  std::string chunk(65'536, '\0');
  while (answer.size() < kMostBytes && socket.Ready(POLLIN, deadline)) {
    const ssize_t got = recv(socket.fd(), chunk.data(), chunk.size(), 0);
    if (got == 0) return answer;
    if (got < 0 && errno != EINTR && errno != EAGAIN) break;
    if (got > 0) answer.append(chunk, 0, static_cast<size_t>(got));
  }
  return absl::UnavailableError("it does not answer in time");
}

}  // namespace

absl::StatusOr<MetricsPage> FetchMetrics(const std::string& url, milliseconds patience) {
  const auto address = ParseUrl(url);
  if (!address.ok()) return address.status();
  const auto deadline = steady_clock::now() + patience;

  addrinfo hints = {};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (getaddrinfo(address->host.c_str(), address->port.c_str(), &hints, &found) != 0) {
    return NotThere(url, "the host is not known");
  }
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> addresses(found, freeaddrinfo);
  for (const addrinfo* to = addresses.get(); to != nullptr; to = to->ai_next) {
    const Socket socket(::socket(to->ai_family, to->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    if (socket.fd() < 0) continue;
    if (connect(socket.fd(), to->ai_addr, to->ai_addrlen) != 0 && errno != EINPROGRESS) continue;
    // With HTTP/1.0, the answer comes in one piece and ends with the connection.
    const auto answer =
        Exchange(socket,
                 absl::StrCat("GET ", address->path, " HTTP/1.0\r\nHost: ", address->host,
                              "\r\nAccept: text/plain\r\n\r\n"),
                 deadline);
    if (!answer.ok()) {
      if (to->ai_next != nullptr) continue;
      return NotThere(url, std::string(answer.status().message()).c_str());
    }
    const size_t body = answer->find("\r\n\r\n");
    const size_t status = answer->find(' ');
    if (body == std::string::npos || answer->compare(status, 4, " 200") != 0) {
      return NotThere(url, "the answer is not 200 OK");
    }
    return MetricsPage::Parse(std::string_view(*answer).substr(body + 4));
  }
  return NotThere(url, "nobody listens there");
}

}  // namespace maneuver::load

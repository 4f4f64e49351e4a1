#include <httplib.h>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "client/load/metrics_page.h"

namespace maneuver::load {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr size_t kMostBytes = size_t{16} << 20;
constexpr int kHttpPort = 80;
constexpr int kMostPort = 65'535;

struct Address {
  std::string host;
  int port = kHttpPort;
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
  const bool good_port = has_port ? absl::SimpleAtoi(authority.substr(colon + 1), &address.port) &&
                                        address.port > 0 && address.port <= kMostPort
                                  : has_scheme;
  if (address.host.empty() || !good_port) {
    return absl::InvalidArgumentError(absl::StrCat(
        url, " is not an address of a metrics page, such as http://127.0.0.1:9470/metrics"));
  }
  return address;
}

absl::Status NotThere(const std::string& url, absl::string_view why) {
  return absl::UnavailableError(absl::StrCat("no metrics at ", url, ": ", why));
}

absl::string_view Explain(httplib::Error error) {
  switch (error) {
    case httplib::Error::Connection:
      return "nobody listens there";
    case httplib::Error::ConnectionTimeout:
    case httplib::Error::Read:
    case httplib::Error::Write:
      return "it does not answer in time";
    case httplib::Error::Canceled:
      return "the page is too large or too slow";
    default:
      return "the answer is not HTTP";
  }
}

}  // namespace

absl::Status CheckMetricsAddress(const std::string& url) { return ParseUrl(url).status(); }

absl::StatusOr<MetricsPage> FetchMetrics(const std::string& url, milliseconds patience) {
  const auto address = ParseUrl(url);
  if (!address.ok()) return address.status();
  const auto deadline = steady_clock::now() + patience;
  httplib::Client client(address->host, address->port);
  client.set_connection_timeout(patience);
  client.set_read_timeout(patience);
  client.set_write_timeout(patience);
  std::string page;
  const auto answer =
      client.Get(address->path, {{"Accept", "text/plain"}}, [&](const char* data, size_t size) {
        if (page.size() + size > kMostBytes || steady_clock::now() > deadline) return false;
        page.append(data, size);
        return true;
      });
  if (!answer) return NotThere(url, Explain(answer.error()));
  if (answer->status != 200) return NotThere(url, "the answer is not 200 OK");
  return MetricsPage::Parse(page);
}

}  // namespace maneuver::load
